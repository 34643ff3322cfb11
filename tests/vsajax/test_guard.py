"""What keeps broken samples out: the state, the answer and the count, online and over a recording."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.vsajax.estimators.registry import ESTIMATORS, full_recording
from vsajax import Guarded, Recording, Sample, rollout
from vsajax.compliance import ArmReading
from vsajax.estimators import RecursiveLeastSquares
from vsajax.experiments import estimation
from vsajax.guard import LARGEST_READING, is_sound

NAME = "sensor"


def broken_at(places, values, signal="elastic_torque") -> Recording:
    recording = full_recording(120)
    changed = np.array(getattr(recording, signal))
    changed[list(places)] = values
    return recording._replace(**{signal: jnp.asarray(changed)})


def online(estimator, recording):
    guarded = Guarded(estimator)
    samples = recording.samples()
    state = guarded.init(jax.tree.map(lambda x: x[0], samples))
    return rollout.scan(guarded.step, state, samples)[1]


@pytest.mark.failure
@pytest.mark.parametrize("reading", [np.nan, np.inf, -np.inf, 1e30, -2.0 * LARGEST_READING])
def test_what_is_no_reading_is_not_sound(reading):
    assert is_sound(Sample(jnp.asarray(0.0), link_position=jnp.asarray(LARGEST_READING)))
    assert not is_sound(Sample(jnp.asarray(0.0), link_position=jnp.asarray(reading)))
    assert not is_sound(Sample(jnp.asarray(reading), link_position=jnp.asarray(0.0)))
    assert not is_sound(Sample(jnp.asarray(-1e-3)))


@pytest.mark.failure
def test_a_wish_of_an_arm_is_left_to_its_design():
    still = jnp.zeros(2)
    assert is_sound(ArmReading(still, still, still, jnp.full((2, 2), jnp.nan)))
    assert not is_sound(ArmReading(still, still.at[1].set(jnp.nan), still, jnp.eye(2)))


@pytest.mark.equivalence
@pytest.mark.parametrize("name", ESTIMATORS)
def test_online_and_over_a_recording_the_same_samples_are_left_out(name):
    recording = full_recording(120)
    for signal, place, value in (
        ("motor_position", 0, np.nan),
        ("motor_torque", 40, np.inf),
        ("link_position", 41, 1e30),
    ):
        changed = np.array(getattr(recording, signal))
        changed[place] = value
        recording = recording._replace(**{signal: jnp.asarray(changed)})
    recording = recording._replace(elastic_torque=recording.elastic_torque.at[80].set(jnp.nan))
    kept = {s: getattr(recording, s) for s in Recording._fields if s in ESTIMATORS[name].needs}
    recording = Recording(recording.time, **kept)
    left_out = {k for k in (0, 40, 41, 80) if any(not abs(values[k]) < 1e9 for values in kept.values())}
    one, other = online(ESTIMATORS[name], recording), estimation.estimate(ESTIMATORS[name], recording)
    for answer in (one, other):
        assert set(np.flatnonzero(answer.held).tolist()) == left_out
        assert int(answer.skipped[-1]) == len(left_out)
        assert not answer.known[jnp.asarray(sorted(left_out), int)].any()
        assert np.isfinite(answer.stiffness).all()
    np.testing.assert_allclose(one.stiffness, other.stiffness, rtol=1e-6, atol=1e-9 * np.abs(one.stiffness).max())


@pytest.mark.equivalence
def test_a_sample_left_out_is_one_that_was_never_taken():
    recording = broken_at([7, 50, 51, 119], np.nan)
    sound = np.setdiff1d(np.arange(120), [7, 50, 51, 119])
    whole = estimation.estimate(ESTIMATORS[NAME], recording)
    shorter = estimation.estimate(ESTIMATORS[NAME], jax.tree.map(lambda x: x[sound], recording))
    assert np.array_equal(whole.stiffness[sound], shorter.stiffness)
    assert np.array_equal(whole.stiffness[50:52], np.repeat(whole.stiffness[49], 2))


@pytest.mark.failure
def test_nothing_sound_is_nothing_known():
    answer = estimation.estimate(ESTIMATORS[NAME], broken_at(range(120), np.nan))
    assert answer.held.all()
    assert not answer.known.any()
    assert np.isinf(answer.stiffness_std).all()


@pytest.mark.failure
@pytest.mark.parametrize("feature", [np.nan, np.inf, 1e200])
def test_features_that_overflow_do_not_enter_the_fit(feature):
    fit = RecursiveLeastSquares(10.0)
    state, _ = fit.step(fit.init(2), jnp.asarray([1.0, 0.5]), jnp.asarray(3.0))
    after, _ = fit.step(state, jnp.asarray([feature, 0.5]), jnp.asarray(3.0))
    assert np.array_equal(after.covariance, state.covariance)
    assert np.array_equal(after.coefficients, state.coefficients)
    assert after.weight == state.weight
    torque, _ = fit.step(state, jnp.asarray([0.5, 1.0]), jnp.asarray(np.inf))
    assert np.array_equal(torque.coefficients, state.coefficients)
    assert np.isfinite(torque.squares)
    assert np.isnan(fit.step(state, jnp.asarray([0.5, 1.0]), jnp.asarray(np.nan))[0].coefficients).all()
