"""Features that lag as the residual does: a slow observer must not bias the stiffness."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vsajax import Recording
from vsajax.estimators import (
    AbstractVelocityFilter,
    FiniteDifference,
    KinematicKalman,
    ModifiedKinematicKalman,
    RecursiveLeastSquares,
    ResidualTorque,
    SeparableOddPolynomial,
    StiffnessEstimator,
)
from vsajax.experiments import estimation

INERTIA, DAMPING, GEAR, STIFFNESS, ZERO = 2e-5, 1e-3, 50.0, 120.0, 0.004
SLOW = {
    "kalman": KinematicKalman(3e5, 1.0),
    "mkkf": ModifiedKinematicKalman(3e5, 2.0, 0.5, counts_per_revolution=4000.0),
}


def recording(*, irregular: bool) -> Recording:
    """Return a motor held still by a spring that the link moves: γτ = −τ_e, sampled as exactly as may be."""
    rng = np.random.default_rng(3)
    steps = rng.choice([0.5e-3, 1e-3, 4e-3], 4000) if irregular else np.full(4000, 1e-3)
    time = np.concatenate([[0.0], np.cumsum(steps)])
    deflection = 0.03 * np.sin(2 * np.pi * 1.3 * time) + 0.01 * np.sin(2 * np.pi * 4.1 * time)
    return Recording(
        jnp.asarray(time),
        motor_position=jnp.zeros(len(time)),
        motor_torque=jnp.asarray(-STIFFNESS * (deflection - ZERO) / GEAR),
        deflection=jnp.asarray(deflection),
    )


def estimator(gain: float, *, matched: bool) -> StiffnessEstimator:
    return StiffnessEstimator(
        ResidualTorque(gain, INERTIA, 0.0, GEAR),
        SeparableOddPolynomial(0.03, deflection_offset=True),
        RecursiveLeastSquares(1e9),
        deflection="measured",
        matched=matched,
    )


@pytest.mark.analytic
@pytest.mark.parametrize("irregular", [False, True])
@pytest.mark.parametrize("gain", [5.0, 40.0])
def test_matched_features_find_the_stiffness_whatever_the_observers_gain(gain, irregular):
    answer = jax.jit(estimation.estimate)(estimator(gain, matched=True), recording(irregular=irregular))
    # Residual and features pass one and the same linear recursion: the line is exact but for prior and rounding.
    np.testing.assert_allclose(answer.stiffness[-1], STIFFNESS, rtol=1e-6)
    torque = STIFFNESS * (np.asarray(answer.signals.deflection) - ZERO)
    np.testing.assert_allclose(answer.elastic_torque[-1], torque[-1], rtol=1e-5)


@pytest.mark.analytic
def test_unmatched_features_are_biased_by_a_slow_observer():
    # At 1.3 Hz an observer of 5 1/s passes 52 % of the torque, turned by 58°: the slope loses most of it.
    answer = jax.jit(estimation.estimate)(estimator(5.0, matched=False), recording(irregular=False))
    assert answer.stiffness[-1] < 0.4 * STIFFNESS


def moving(*, irregular: bool) -> Recording:
    """Return a motor that moves: its friction takes two thirds of the torque that the spring takes."""
    fixed = recording(irregular=irregular)
    time, deflection = np.asarray(fixed.time), np.asarray(fixed.deflection)
    rate = 2 * np.pi * 0.7
    # It starts at rest, as the filters do.
    position, velocity = 0.3 - 0.3 * np.cos(rate * time), 0.3 * rate * np.sin(rate * time)
    friction = GEAR * (DAMPING * velocity + INERTIA * rate**2 * (0.3 - position))
    return fixed._replace(
        link_position=jnp.asarray(position + deflection),
        motor_position=jnp.asarray(position),
        motor_torque=jnp.asarray(friction - STIFFNESS * (deflection - ZERO) / GEAR),
    )


def filtering(*, matched: bool, deflection: str, velocity: AbstractVelocityFilter) -> StiffnessEstimator:
    return StiffnessEstimator(
        ResidualTorque(40.0, INERTIA, DAMPING, GEAR),
        SeparableOddPolynomial(0.03, deflection_offset=True),
        RecursiveLeastSquares(1e3),
        velocity=velocity,
        deflection=deflection,
        matched=matched,
    )


@pytest.mark.analytic
@pytest.mark.parametrize("irregular", [False, True])
@pytest.mark.parametrize("deflection", ["raw", "filtered", "measured"])
@pytest.mark.parametrize("velocity", SLOW)
def test_matched_features_are_as_late_as_the_filter_of_the_velocity(velocity, deflection, irregular):
    # The filters are late by 60 ms. What is left is the start: they take the deflection for at rest.
    data = moving(irregular=irregular)
    answers = {
        matched: jax.jit(estimation.estimate)(
            filtering(matched=matched, deflection=deflection, velocity=SLOW[velocity]), data
        )
        for matched in (True, False)
    }
    assert abs(answers[True].stiffness[-1] / STIFFNESS - 1.0) < 0.01
    if deflection != "filtered":
        assert abs(answers[False].stiffness[-1] / STIFFNESS - 1.0) > 0.05


@pytest.mark.analytic
def test_a_filter_that_delays_nothing_changes_nothing():
    plain = filtering(matched=True, deflection="raw", velocity=FiniteDifference())
    assert plain.init(jax.tree.map(lambda x: x[0], moving(irregular=False).samples())).followed is None


@pytest.mark.gradient
def test_the_answers_derivative_by_the_gain_is_that_of_finite_differences():
    data = recording(irregular=True)

    def last(gain: jax.Array) -> jax.Array:
        return estimation.estimate(
            StiffnessEstimator(
                ResidualTorque(gain, INERTIA, 1e-3, GEAR),
                SeparableOddPolynomial(0.03),
                RecursiveLeastSquares(1.0),
                deflection="measured",
                matched=True,
            ),
            data,
        ).stiffness[-1]

    run, gain, step = jax.jit(last), 20.0, 1e-3
    forward = jax.jit(jax.jacfwd(last))(gain)
    reverse = jax.jit(jax.jacrev(last))(gain)
    central = (run(gain + step) - run(gain - step)) / (2 * step)
    np.testing.assert_allclose(forward, central, rtol=1e-6)
    np.testing.assert_allclose(reverse, forward, rtol=1e-9)
