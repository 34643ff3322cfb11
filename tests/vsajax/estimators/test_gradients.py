"""Derivatives of the tuning objective: forward mode, reverse mode and finite differences."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.vsajax.builders import paper_basis, paper_estimator, paper_recording, residual_torque
from tests.vsajax.programs import held_shapes, scans
from vsajax import Recording, Scorer
from vsajax.estimators import (
    ExponentialForgetting,
    FiniteDifference,
    ModifiedKinematicKalman,
    RecursiveLeastSquares,
    SensorTorque,
    StiffnessEstimator,
)
from vsajax.experiments import estimation
from vsajax.rollout import sensitivity

pytestmark = pytest.mark.gradient

SAMPLES = 400
NAMES = ("observer gain", "V_a", "prior scale", "V_max", "V_min", "sharpness")
AT = np.log([300.0, 5e9, 1.0, 10.0, 0.1, 6.0])


def tuned(log_parameters: jax.Array) -> StiffnessEstimator:
    gain, acceleration, prior, slow, fast, sharpness = jnp.exp(log_parameters)
    return paper_estimator(
        residual_torque(gain),
        basis=paper_basis(2, 2),
        fit=RecursiveLeastSquares(prior),
        velocity=ModifiedKinematicKalman(acceleration, slow, fast, sharpness),
    )


def msrep(estimator: StiffnessEstimator, recording: Recording, stiffness: jax.Array) -> jax.Array:
    observed = estimation.observe(recording, stiffness, scorer=Scorer())
    return sensitivity.sum_of_squares(estimation.residual_loop(estimator, observed, scorer=Scorer()))


def assert_finite(tree) -> None:
    for path, leaf in jax.tree_util.tree_leaves_with_path(tree):
        assert np.all(np.isfinite(leaf)), jax.tree_util.keystr(path)


@pytest.fixture(scope="module")
def objective(golden):
    recording = paper_recording(golden, "residual", SAMPLES)
    stiffness = jnp.asarray(golden["sigma"][:SAMPLES])
    return lambda x: msrep(tuned(x), recording, stiffness)


def test_forward_reverse_and_finite_differences_agree(objective):
    at, step = jnp.asarray(AT), 1e-4
    forward, reverse = jax.jit(jax.jacfwd(objective))(at), jax.jit(jax.grad(objective))(at)
    np.testing.assert_allclose(reverse, forward, rtol=1e-9)
    # Five-point differences along each logarithm, over which the objective varies at unit scale: truncation
    # step⁴ = 1e-16, rounding of the regression 1e-12/step = 1e-8.
    offsets = jnp.asarray([-2, -1, 1, 2])[:, None, None] * step * jnp.eye(len(AT))
    values = jax.jit(lambda x: jax.lax.map(objective, x))((at + offsets).reshape(-1, len(AT))).reshape(4, -1)
    differences = jnp.asarray([1, -8, 8, -1]) @ values / (12 * step)
    for name, ours, theirs in zip(NAMES, forward, differences, strict=True):
        assert ours == pytest.approx(float(theirs), rel=1e-6), name
        assert abs(ours) > 1e-4 * abs(values[0, 0]), f"the objective does not feel {name}"


@pytest.mark.parametrize(
    ("mode", "deflection", "source"),
    [
        (jax.jacfwd, "filtered", residual_torque()),
        (jax.jacrev, "filtered", residual_torque()),
        (jax.jacrev, "raw", SensorTorque()),
        (jax.jacrev, "measured", SensorTorque()),
    ],
    ids=["forward", "reverse", "raw", "measured"],
)
def test_derivatives_are_finite_without_deflection_and_noise(mode, deflection, source):
    # Everything at rest: φ = 0, every speed 0, every innovation 0.
    still = jnp.zeros(30)
    recording = Recording(jnp.arange(30) * 1e-3, *(still,) * 6)
    estimator = paper_estimator(source, basis=paper_basis(2, 1), deflection=deflection)
    slopes = jax.jit(mode(lambda e: msrep(e, recording, jnp.full(30, 100.0))))(estimator)
    assert_finite(slopes)


def test_absent_options_have_no_derivative_and_present_ones_a_finite_one(golden):
    recording = paper_recording(golden, "residual", 100)
    stiffness = jnp.asarray(golden["sigma"][:100])
    torques = (
        residual_torque(),
        eqx.tree_at(
            lambda t: t.friction_torque, residual_torque(), jnp.asarray(0.01), is_leaf=lambda x: x is None
        ),
    )
    plain, rubbing = (
        jax.jit(jax.grad(msrep))(paper_estimator(torque, basis=paper_basis(1, 1)), recording, stiffness)
        for torque in torques
    )
    assert plain.torque.friction_torque is None
    assert rubbing.torque.friction_torque != 0.0
    assert_finite((plain, rubbing))


@pytest.mark.parametrize(
    "velocity",
    [FiniteDifference(), ModifiedKinematicKalman(5e9, scaling="printed")],
    ids=["difference", "printed"],
)
def test_other_filters_and_forgetting_have_finite_derivatives(golden, velocity):
    estimator = paper_estimator(
        residual_torque(),
        basis=paper_basis(1, 1),
        velocity=velocity,
        # A wide prior: what is not yet learnt cannot be forgotten.
        fit=RecursiveLeastSquares(1e6, ExponentialForgetting(0.99)),
    )
    recording = paper_recording(golden, "residual", 100)
    slopes = jax.jit(jax.grad(msrep))(estimator, recording, jnp.asarray(golden["sigma"][:100]))
    assert_finite(slopes)
    assert slopes.fit.law.forgetting != 0.0


def test_every_answer_carries_the_priors_closed_form_derivative(golden):
    recording = paper_recording(golden, "residual", SAMPLES)

    def answers(log_prior):
        fit = RecursiveLeastSquares(jnp.exp(log_prior))
        estimate = estimation.estimate(
            paper_estimator(residual_torque(), basis=paper_basis(2, 2), fit=fit), recording
        )
        signals = estimate.signals
        late = slice(SAMPLES // 2, None)
        return {
            "stiffness": estimate.stiffness[late],
            "standard deviation": estimate.stiffness_std[late],
            "torque": estimate.elastic_torque[late],
            "determined": signals.determined[late],
        }

    at, step = jnp.asarray(0.3), 1e-3
    ours = jax.jit(jax.jacfwd(answers))(at)
    run = jax.jit(answers)
    two_before, before, after, two_after = (run(at + n * step) for n in (-2, -1, 1, 2))
    for name, slope in ours.items():
        theirs = (two_before[name] - 8 * before[name] + 8 * after[name] - two_after[name]) / (12 * step)
        scale = float(jnp.max(jnp.abs(theirs)))
        np.testing.assert_allclose(slope, theirs, rtol=1e-6, atol=1e-6 * scale, err_msg=name)
        assert scale > 1e-3 * float(jnp.max(jnp.abs(run(at)[name]))), f"{name} does not feel the prior"


@pytest.mark.structure
@pytest.mark.parametrize(
    ("deflection", "matched", "times"), [("raw", False, 1), ("filtered", False, 2), ("raw", True, 2)]
)
def test_the_covariance_has_a_derivative_only_where_the_features_have_one(golden, deflection, matched, times):
    basis, recording = paper_basis(2, 2), paper_recording(golden, "residual", 16)

    def residuals(log_parameters):
        own = tuned(log_parameters)
        estimator = StiffnessEstimator(
            own.torque, basis, own.fit, own.velocity, deflection=deflection, matched=matched
        )
        observed = estimation.observe(recording, jnp.ones(16), scorer=Scorer())
        return sensitivity.run(estimation.residual_loop(estimator, observed, scorer=Scorer()))

    program = jax.make_jaxpr(jax.jacfwd(residuals))(jnp.asarray(AT))
    covariances = [sum(shape.count(basis.size) == 2 for shape in held_shapes(loop)) for loop in scans(program)]
    assert max(covariances) == times
