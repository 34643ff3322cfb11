"""What the generator makes of a step: every operation, every hazard of order, and what it must refuse."""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.tuning.exports.native import answers_of, needs_compiler, replay
from tests.vsajax.estimators.parts import BASES, LAWS
from tests.vsajax.estimators.registry import ESTIMATORS, full_recording
from tuning.exports.c99.files import write
from tuning.exports.c99.generate import generate
from tuning.exports.flatten import Untraceable
from tuning.exports.program import program_of, trace
from tuning.kinds.estimation.deployable import inputs_of, sample_of
from vsajax import Guarded, Recording, plants
from vsajax import estimators as es
from vsajax.numerics import once
from vsajax.types import as_leaf

LENGTH = 70
"""Of the arrays below: beyond what the generator leaves unfused."""


class Gains(eqx.Module):
    """Parameters of no estimator.

    Args:
        gain: of the feedback [1/s].
        table: weights.
    """

    gain: Any = eqx.field(converter=as_leaf, default=0.3)
    table: Any = eqx.field(converter=as_leaf, default_factory=lambda: jnp.linspace(-1.0, 1.0, LENGTH))


class Signals(NamedTuple):
    """Two signals.

    Args:
        x: position [m].
        y: force [N].
    """

    x: Any
    y: Any


class Memory(NamedTuple):
    """A state whose parts are written from one another."""

    first: Any
    second: Any
    ring: Any
    sums: tuple[Any, ...]


class Answer(NamedTuple):
    """Numbers and a verdict."""

    values: tuple[Any, ...]
    is_high: Any


def toy(step, outputs: int, samples: int = 40):
    """Return a program around a step, its module, and what jax answers to noise."""
    module, one = Gains(), Signals(jnp.zeros(()), jnp.zeros(()))

    def init(module: Gains, sample: Signals) -> Memory:
        zero = sample.x * 0.0
        return Memory(zero, zero + 1.0, jnp.zeros(LENGTH) + sample.y, (zero,) * 5)

    program = trace("toy", "a toy", module, one, init, step)
    rng = np.random.default_rng(3)
    inputs = Signals(*(jnp.asarray(rng.normal(size=samples)) for _ in range(2)))
    golden = answers_of(program, module, step, init, inputs)
    assert len(program.outputs.places) == outputs
    return program, golden


def exercised(module: Gains, state: Memory, u: Signals) -> tuple[Memory, Answer]:
    """Use every operation that the generator knows and an estimator might."""
    x, y = u
    grid = jnp.arange(LENGTH) * module.gain
    window = jnp.clip(1.0 - grid, -0.5, 0.9) + jnp.where(jnp.arange(LENGTH) % 3 == 1, 0.25, x)
    shifted = jnp.concatenate([jnp.zeros(2), window[:-2]])
    matrix = jnp.stack([jnp.stack([x, y, x * y]), jnp.stack([y, -x, x + y])])
    product = matrix @ jnp.stack([1.0 + x, y, 0.5 - y])
    values = (
        jnp.sum(window * module.table) + jnp.max(shifted) - jnp.min(window[::-1] * y),
        jnp.floor(3.0 * x) + jnp.round(2.5 + jnp.floor(y)) + jnp.ceil(x) + jnp.sign(y),
        jnp.sqrt(jnp.abs(x)) + jnp.exp(-x) + jnp.expm1(0.1 * y) + jnp.log1p(x * x) + jnp.tanh(y),
        jnp.sin(x) + jnp.cos(y) + jnp.arctan2(y, x) + jnp.sinh(0.1 * x) + jnp.cosh(0.1 * y) + jnp.tan(0.1 * x),
        x**3 + y**-2 + (1.0 + x * x) ** 1.5 + jnp.square(y) + jax.lax.rem(x, 0.3),
        product[0] + product[1] + jnp.sum(matrix.T[1:] * 2.0),
        jnp.where((x > 0.0) & ~(y >= x) | (y == 0.0), x - (y - x), x / (y * x - (x - y))),
        jnp.maximum(jnp.minimum(x, y), 0.1) + jax.nn.sigmoid(x) + jax.lax.rsqrt(1.0 + y * y),
    )
    return state, Answer(values, jnp.isfinite(x) & (x != y) & (y < 1.0))


def tangled(module: Gains, state: Memory, u: Signals) -> tuple[Memory, Answer]:
    """Write a state from its own old values in an order that a careless generator would get wrong."""
    first, second = state.second + u.x, state.first - u.y
    ring = jnp.concatenate([u.x[None], state.ring[:-1]])
    delayed = jnp.sum(state.ring[1:] * ring[:-1])
    rotated = (*state.sums[1:], state.sums[0] + module.gain * first)
    features = once(tuple(u.x * s + i for i, s in enumerate(state.sums)))
    answer = sum(features) + state.ring[-1] + state.first
    return Memory(first, second, ring, rotated), Answer((answer, delayed, *rotated, ring[3]), first > second)


@needs_compiler
@pytest.mark.equivalence
@pytest.mark.parametrize(("step", "outputs"), [(exercised, 9), (tangled, 9)])
def test_c_answers_as_jax_does(step, outputs, tmp_path):
    program, golden = toy(step, outputs)
    worst = replay(program, golden, tmp_path, "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    assert max(worst.values()) < 1e-12, worst


@needs_compiler
@pytest.mark.equivalence
def test_the_harness_sees_a_wrong_answer(tmp_path):
    program, golden = toy(tangled, 9)
    golden.outputs["values[0]"] = golden.outputs["values[0]"] * (1.0 + 1e-6)
    assert replay(program, golden, tmp_path)["values[0]"] > 1e-8


def plain(torque=None, basis=None, law=None) -> es.StiffnessEstimator:
    """Return an estimator of few parts around the one that is tried."""
    fit = es.RecursiveLeastSquares(1e3, law or es.UnitFactor())
    return es.StiffnessEstimator(
        torque or es.SensorTorque(), basis or es.Taylor(0.1, order=1), fit, deflection="raw"
    )


def windowed(quadrature: str) -> es.AlgebraicObserver:
    """Return an observer whose window has another quadrature."""
    fit, basis = es.RecursiveLeastSquares(1e3), es.Taylor(0.1, order=1)
    options = {"quadrature": quadrature, "weighting": "continuous", "start": "zeros"}
    return es.AlgebraicObserver(1e-4, 1.27, 0.02, basis, fit, longest_window=0.02, **options)


SPRINGS = {
    "linear": plants.LinearSpring(100.0),
    "polynomial": plants.PolynomialSpring([80.0, 100.0, 30.0]),
    "exponential": plants.ExponentialSpring(2.0, 3.0),
    "hyperbolic": plants.HyperbolicSpring(2.0, 3.0),
    "lever": plants.LeverSpring(7e3, 0.1, 4e-4),
}
PARTS = {
    **{f"basis {name}": plain(basis=basis) for name, basis in BASES.items()},
    **{f"law {name}": plain(law=law) for name, law in LAWS.items()},
    **{f"spring {name}": plain(es.ModelTorque(spring)) for name, spring in SPRINGS.items()},
    "friction": plain(es.ResidualTorque(100.0, 1e-4, 1e-3, friction_torque=0.01)),
    **{name: windowed(name) for name in ("trapezoid", "simpson")},
}


@needs_compiler
@pytest.mark.equivalence
@pytest.mark.contract
@pytest.mark.slow(
    twin=(
        "test_c_answers_as_jax_does",
        "tests/tuning/exports/test_families.py::test_every_format_of_every_family_holds",
    )
)
@pytest.mark.parametrize("name", [*ESTIMATORS, *PARTS])
def test_every_estimator_and_part_is_the_same_in_c(name, tmp_path):
    estimator = (ESTIMATORS | PARTS)[name]
    program = program_of(estimator, sample_of(inputs_of(estimator)), name="one", title=name)
    signals = full_recording(120)
    kept = {signal: getattr(signals, signal) for signal in inputs_of(estimator)}
    samples = Recording(signals.time, **kept).samples()
    guarded = Guarded(estimator)
    golden = answers_of(program, guarded, lambda e, s, u: e.step(s, u), lambda e, u: e.init(u), samples)
    worst = replay(program, golden, tmp_path, "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    assert max(worst.values()) < 1e-9, worst


@pytest.mark.structure
def test_generated_code_has_the_names_units_and_places_of_the_source():
    program = program_of(
        ESTIMATORS["residual"], sample_of(inputs_of(ESTIMATORS["residual"])), name="joint", title="a joint"
    )
    source = write(program, generate(program), banner="from a test")
    for words in (
        "joint_real observer_gain; /* K_I; the observer's bandwidth. Above 2/T it rings [1/s] */",
        "joint_real motor_torque; /* principal motor, on the motor axis [N·m] */",
        "bool known;",
        "joint_kalman_state motor;",
    ):
        assert words in source.header
    for words in ("vsajax/estimators/rls.py, RecursiveLeastSquares.step", "const real gain = ", "correction"):
        assert words in source.source
    for word in ("malloc", "static real", "printf"):
        assert word not in source.source


@pytest.mark.structure
def test_what_follows_from_the_parameters_is_computed_once():
    program = program_of(
        ESTIMATORS["algebraic"], sample_of(inputs_of(ESTIMATORS["algebraic"])), name="window", title="a window"
    )
    generated = generate(program)
    taps = ESTIMATORS["algebraic"].taps
    assert {one.shape for one in generated.derived} >= {(taps,)}
    # A step: three products a tap and feature, and what does not depend on the window.
    assert generated.operations["mul"] < 8 * taps + 200
    assert generated.operations["div"] < 60


def test_numbers_that_a_step_does_not_read_are_no_parameters():
    names = program_of(
        ESTIMATORS["model"], sample_of(inputs_of(ESTIMATORS["model"])), name="model", title=""
    ).parameters.names
    assert names == [
        "torque.law.linear",
        "torque.law.cubic",
        "basis.deflection_scale",
        "fit.prior_scale",
        "fit.law.forgetting",
        "fit.band",
        "gate.min_deflection_range",
        "gate.max_relative_std",
    ]


def branching(module, state, u):
    return state, Answer((jax.lax.cond(u.x > 0.0, lambda: u.y, lambda: u.x),), u.x > 0.0)


def looping(module, state, u):
    return state, Answer((jax.lax.while_loop(lambda a: a < 1.0, lambda a: a + u.x, u.y),), u.x > 0.0)


def sorting(module, state, u):
    return state, Answer((jnp.sort(state.ring)[0],), u.x > 0.0)


@pytest.mark.failure
@pytest.mark.parametrize(
    ("step", "said"),
    [(branching, "cond"), (looping, "branches or loops on data"), (sorting, "the operation sort")],
)
def test_what_has_no_counterpart_is_refused_with_the_operation(step, said):
    one = Signals(jnp.zeros(()), jnp.zeros(()))
    state = Memory(one.x, one.x, jnp.zeros(LENGTH), (one.x,))
    with pytest.raises(Untraceable, match=said):
        generate(trace("toy", "", Gains(), one, lambda *_: state, step))
