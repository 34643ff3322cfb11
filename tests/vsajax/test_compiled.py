"""What the estimator compiles to: no library calls, one trace, shared gains, bounded memory."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.vsajax.builders import paper_basis, paper_estimator, paper_recording, residual_torque
from tests.vsajax.programs import equations, held_shapes, scans
from vsajax import Recording, Scorer
from vsajax.estimators import ModifiedKinematicKalman, RecursiveLeastSquares
from vsajax.experiments import estimation

pytestmark = pytest.mark.structure

SIZE = 18
GAINS = 7


def abstract_recording(samples: int, lanes: int) -> tuple[Recording, Recording]:
    """Return shapes of a `(time, lane)` recording for the residual estimator, and its batch axes."""
    wave = jax.ShapeDtypeStruct((samples, lanes), jnp.float64)
    shapes = Recording(jax.ShapeDtypeStruct((samples,), jnp.float64), wave, wave, wave, wave)
    return shapes, Recording(None, 1, 1, 1, 1)


def estimator(gain=300.0, acceleration=5e9, prior=1.0):
    return paper_estimator(
        residual_torque(gain),
        fit=RecursiveLeastSquares(prior),
        velocity=ModifiedKinematicKalman(acceleration),
    )


def test_batched_estimate_calls_no_library():
    # LAPACK in a scan body costs thirtyfold; so would a callback or a random number.
    shapes, axes = abstract_recording(100, 8)
    run = jax.jit(jax.vmap(estimation.estimate, in_axes=(None, axes)))
    text = run.lower(estimator(), shapes).compile().as_text()
    assert "while" in text
    assert "custom-call" not in text
    assert "rng" not in text


def test_scan_bodies_hold_neither_reductions_nor_products_of_matrices(golden):
    program = jax.make_jaxpr(estimation.estimate)(estimator(), paper_recording(golden, "residual", 20))
    bodies = [scan.params["jaxpr"] for scan in scans(program)]
    names = {equation.primitive.name for body in bodies for equation in equations(body)}
    assert "mul" in names
    forbidden = {
        "dot_general",
        "reduce_sum",
        "triangular_solve",
        "cholesky",
        "random_bits",
        "pure_callback",
        "sort",
    }
    assert not names & forbidden


def test_a_thousand_parameter_values_share_one_trace(golden):
    recording = jax.tree.map(lambda x: x[1000:1005], paper_recording(golden, "residual"))
    traces = 0

    @eqx.filter_jit
    def run(estimator):
        nonlocal traces
        traces += 1
        return estimation.estimate(estimator, recording).stiffness[-1]

    rng = np.random.default_rng(0)
    kinds = [float, np.float32, jnp.asarray, lambda x: int(x) + 1]
    answers = {
        float(
            run(
                paper_estimator(
                    residual_torque(kinds[i % 4](gain)),
                    basis=paper_basis(1, 1),
                    fit=RecursiveLeastSquares(kinds[i // 4 % 4](prior)),
                )
            )
        )
        for i, (gain, prior) in enumerate(rng.uniform(1.0, 1e3, (1000, 2)))
    }
    assert traces == 1
    assert len(answers) > 900


def scans_with_gains(function, recording) -> list[list[tuple[int, ...]]]:
    """Return what the estimator's scans carry when `function` is vmapped over `GAINS` values."""
    values = jnp.linspace(1.0, 2.0, GAINS)
    program = jax.make_jaxpr(jax.vmap(lambda x: function(x, recording)))(values)
    return [shapes for shapes in map(held_shapes, scans(program)) if any(s[-2:] == (SIZE, SIZE) for s in shapes)]


def judged(estimator, recording):
    """Return what sweeps and tuning compute: of a simulated recording, in which no sample is broken."""
    truth = jnp.ones_like(recording.time)
    return estimation.score(estimator, recording, truth, scorer=Scorer()).msrep


@pytest.mark.parametrize(
    ("function", "is_shared"),
    [
        (lambda x, r: judged(estimator(gain=300.0 * x), r), True),
        (lambda x, r: judged(estimator(), r._replace(motor_torque=x * r.motor_torque)), True),
        (lambda x, r: judged(estimator(prior=x), r), False),
        (lambda x, r: judged(estimator(acceleration=5e9 * x), r), False),
    ],
    ids=["observer gain", "torque", "prior scale", "V_a"],
)
def test_covariance_is_shared_by_what_only_touches_the_torque(golden, function, is_shared):
    # P follows from regressors and prior alone: one P for all observer gains and torque-noise draws.
    scans = scans_with_gains(function, paper_recording(golden, "residual", 20))
    assert scans
    for carry in scans:
        covariances = [shape for shape in carry if shape[-2:] == (SIZE, SIZE)]
        assert covariances == ([(SIZE, SIZE)] if is_shared else [(GAINS, SIZE, SIZE)])
        assert (GAINS, SIZE) in carry


def test_cost_grows_with_the_gain_axis_not_with_the_product(golden):
    # Of the flops of one estimate, most are the covariance; a further gain adds only the coefficients.
    recording = paper_recording(golden, "residual", 20)

    def flops(gains: int) -> float:
        run = jax.jit(jax.vmap(lambda x: estimation.estimate(estimator(gain=x), recording).stiffness))
        return run.lower(jax.ShapeDtypeStruct((gains,), jnp.float64)).compile().cost_analysis()["flops"]

    few, many = flops(2), flops(34)
    assert many / few < 34 / 2 / 3


@pytest.mark.slow(twin="tests/vsajax/rollout/test_loops.py::test_reverse_memory_grows_with_the_root_of_the_length")
def test_reverse_gradient_fits_in_memory():
    samples, lanes = 10_000, 256
    shapes, axes = abstract_recording(samples, lanes)
    stiffness = jax.ShapeDtypeStruct((samples, lanes), jnp.float64)

    def msrep(parameters, recording, stiffness):
        return estimation.score(estimator(*parameters), recording, stiffness, scorer=Scorer()).msrep

    def total(parameters, recordings, stiffnesses):
        return jnp.sum(jax.vmap(msrep, (None, axes, 1))(parameters, recordings, stiffnesses))

    parameters = (jax.ShapeDtypeStruct((), jnp.float64),) * 3
    compiled = jax.jit(jax.grad(total)).lower(parameters, shapes, stiffness).compile()
    temporaries = compiled.memory_analysis().temp_size_in_bytes
    # P, η and some 40 numbers a lane, 2·√10,000 times: 2·100·256·380·8 bytes = 156 MB; all 10,000 would be 7.8 GB.
    assert temporaries < 200e6
    assert temporaries > 100e6, "much less than the states themselves: does it still differentiate all of it?"
