import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.oracles.kalman import mkkf
from tests.vsajax.builders import quantise
from vsajax import estimators, rollout
from vsajax.estimators import FiniteDifference, KinematicKalman, ModifiedKinematicKalman

FILTERS = {
    "difference": FiniteDifference(),
    "kalman": KinematicKalman(5e9, 10.0),
    "modified": ModifiedKinematicKalman(5e9),
    "printed": ModifiedKinematicKalman(5e9, scaling="printed"),
}

each_filter = pytest.mark.parametrize("velocity", FILTERS.values(), ids=FILTERS.keys())


def run(velocity, readings, dt):
    """Return the filter's positions and velocities."""

    def step(state, inputs):
        return velocity.step(state, *inputs)

    inputs = (jnp.asarray(readings), jnp.asarray(dt))
    return np.stack(jax.jit(lambda x: rollout.scan(step, velocity.init(x[0][0]), x)[1])(inputs))


def regular(samples: int) -> np.ndarray:
    return np.concatenate([[0.0], np.full(samples - 1, 1e-3)])


def assert_close(ours, theirs, relative):
    """Compare positions and velocities, each relative to its own full scale."""
    for left, right in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(left, right, rtol=0.0, atol=relative * np.max(np.abs(right)))


@pytest.mark.contract
def test_registry_holds_every_filter():
    classes = {cls for _, cls in inspect.getmembers(estimators, inspect.isclass)}
    filters = {cls for cls in classes if issubclass(cls, estimators.AbstractVelocityFilter)}
    assert {type(f) for f in FILTERS.values()} == filters - {estimators.AbstractVelocityFilter}


@pytest.mark.contract
@each_filter
def test_resting_joint_has_no_velocity(velocity):
    positions, velocities = run(velocity, np.full(50, 0.7), regular(50))
    np.testing.assert_array_equal(positions, 0.7)
    np.testing.assert_array_equal(velocities, 0.0)


@pytest.mark.contract
@each_filter
def test_first_sample_is_taken_as_it_is(velocity):
    _, (position, speed) = velocity.step(velocity.init(jnp.asarray(0.7)), jnp.asarray(0.7), jnp.asarray(0.0))
    assert (position, speed) == (0.7, 0.0)


@pytest.mark.contract
@each_filter
@pytest.mark.parametrize("offset", [1.0, -50.0])
def test_filter_commutes_with_a_shift_of_the_encoder(velocity, offset):
    readings = 0.3 * np.sin(np.arange(200) * 0.02)
    positions, velocities = run(velocity, readings, regular(200))
    shifted, same = run(velocity, readings + offset, regular(200))
    # The shifted readings are rounded to ε·50 rad; over 1 ms that is 1e-11 rad/s, damped by the filter.
    np.testing.assert_allclose(shifted - offset, positions, atol=1e-13)
    np.testing.assert_allclose(same, velocities, atol=2e-11)


@pytest.mark.oracle
@pytest.mark.parametrize("irregular", [False, True])
@pytest.mark.parametrize("modified", [False, True])
def test_kalman_filters_match_their_matrix_forms(golden, irregular, modified):
    readings, dt = quantise(golden["theta"], 40000), regular(len(golden["theta"]))
    if irregular:
        # The same readings, as if the clock had drifted and skipped.
        dt = dt * np.random.default_rng(2).choice([0.5, 1.0, 3.0], len(dt))
    if modified:
        ours, theirs = run(FILTERS["modified"], readings, dt), mkkf(readings, dt)
    else:
        ours, theirs = run(FILTERS["kalman"], readings, dt), mkkf(readings, dt, slow=10.0, fast=10.0)
    assert_close(ours, theirs, 1e-10)


@pytest.mark.oracle
def test_modified_filter_matches_the_reference(reference):
    ours = run(FILTERS["modified"], quantise(reference["theta"], 40000), regular(len(reference["theta"])))
    assert_close(ours, (reference["theta_hat"], reference["dtheta_hat"]), 1e-9)


@pytest.mark.analytic
def test_reading_variance_runs_from_slow_to_fast():
    # One step from a known state: the gain is P/(P + R), so it tells R.
    velocity = ModifiedKinematicKalman(0.0, slow_variance=10.0, fast_variance=0.1, sharpness=6.0)
    count, dt = 2 * np.pi / 40000, 1e-3
    start = velocity.init(jnp.asarray(0.0))._replace(velocity_variance=jnp.asarray(0.0))
    for counts, variance in ((0.0, 10.0 - 9.9 * np.exp(-6) / (1 + np.exp(-6))), (1.0, 5.05), (10.0, 0.1)):
        state = start._replace(velocity=jnp.asarray(-counts * count / dt))
        predicted = -counts * count
        _, (position, _) = velocity.step(state, jnp.asarray(predicted + 1.0), jnp.asarray(dt))
        # P(0) = 10 rad².
        assert float(position) - predicted == pytest.approx(10.0 / (10.0 + variance), rel=1e-12)


@pytest.mark.analytic
def test_printed_scaling_multiplies_by_the_count_instead():
    # |ẋ| w_s with w_s = (2π/Δ)/T = 0.157: at 6.4 rad/s it is one, where (corrected) 40 counts a sample are.
    velocity = ModifiedKinematicKalman(0.0, scaling="printed")
    start = velocity.init(jnp.asarray(0.0))._replace(
        velocity=jnp.asarray(1e-3 * 40000 / (2 * np.pi)), velocity_variance=jnp.asarray(0.0)
    )
    predicted = float(start.velocity) * 1e-3
    _, (position, _) = velocity.step(start, jnp.asarray(predicted + 1.0), jnp.asarray(1e-3))
    assert float(position) - predicted == pytest.approx(10.0 / (10.0 + 5.05), rel=1e-12)


@pytest.mark.analytic
def test_finite_difference_is_the_slope_between_readings():
    dt = np.array([0.0, 1e-3, 2e-3, 5e-4])
    positions, velocities = run(FiniteDifference(), np.array([1.0, 1.5, 1.0, 1.25]), dt)
    np.testing.assert_array_equal(positions, [1.0, 1.5, 1.0, 1.25])
    np.testing.assert_allclose(velocities, [0.0, 500.0, -250.0, 500.0], rtol=1e-15)


@pytest.mark.analytic
@pytest.mark.parametrize("name", ["kalman", "modified"])
def test_kalman_filter_follows_a_constant_speed_without_lag(name):
    time = np.arange(4000) * 1e-3
    positions, velocities = run(FILTERS[name], 2.0 * time, regular(4000))
    # The slowest closed-loop mode of V_a/R = 5e8 is 12 ms: after 4 s only rounding is left.
    assert abs(positions[-1] - 2.0 * time[-1]) < 1e-13
    assert abs(velocities[-1] - 2.0) < 1e-10
