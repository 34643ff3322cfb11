"""A reading that jumps to where nothing can have got to is left out, online and over a recording."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.vsajax.builders import paper_basis, paper_estimator, paper_recording, residual_torque
from tests.vsajax.estimators.registry import ESTIMATORS, full_recording
from vsajax import Guarded, rollout
from vsajax.experiments import estimation
from vsajax.jumps import PATIENCE, taken

SIGNALS = ("link_position", "motor_position", "setpoint_position", "motor_torque")


def are_taken(values, time=None):
    values = np.asarray(values, dtype=float)
    clock = np.arange(len(values)) * 1e-3 if time is None else np.asarray(time)
    return np.asarray(
        jax.jit(taken)(jnp.asarray(values[:, None]), jnp.asarray(clock), jnp.ones(len(values), bool))
    )


@pytest.mark.analytic
def test_what_moves_as_a_joint_does_is_taken_whole():
    time = np.arange(3000) * 1e-3
    rng = np.random.default_rng(0)
    wave = 0.3 * np.sin(2 * np.pi * time**2)
    count = 1e-3
    square = np.sign(np.sin(2 * np.pi * 3.0 * time)) * 0.9
    for signal in (wave, np.round(wave / count) * count, rng.standard_normal(3000), square, np.zeros(3000)):
        assert are_taken(signal).all()


@pytest.mark.analytic
@pytest.mark.parametrize("size", [1e1, -1e2, 1e5, -1e8])
def test_an_outlier_is_left_out_and_nothing_beside_it(size):
    wave = 0.05 * np.sin(2 * np.pi * 0.7 * np.arange(3000) * 1e-3)
    wave[[40, 1200, 1201, 2999]] += size * 0.1
    assert np.flatnonzero(~are_taken(wave)).tolist() == [40, 1200, 1201, 2999]


@pytest.mark.analytic
def test_what_stays_is_taken_after_some_samples():
    wave = 0.05 * np.sin(2 * np.pi * 0.7 * np.arange(1000) * 1e-3)
    wave[500:] += 3.0
    assert np.flatnonzero(~are_taken(wave)).tolist() == [500 + n for n in range(PATIENCE)]


@pytest.mark.analytic
def test_a_gap_in_time_is_no_jump():
    time = np.concatenate([np.arange(500) * 1e-3, 2.0 + np.arange(500) * 1e-3])
    assert are_taken(0.3 * np.sin(2 * np.pi * 0.9 * time), time).all()


@pytest.mark.equivalence
@pytest.mark.parametrize("name", ["sensor", "residual"])
def test_a_first_sample_that_was_the_outlier_is_forgotten(name):
    recording = full_recording(120)
    shorter = jax.tree.map(lambda x: x[PATIENCE + 1 :], recording)
    recording = recording._replace(link_position=recording.link_position.at[0].set(1e6))
    over = estimation.estimate(ESTIMATORS[name], recording)
    guarded, samples = Guarded(ESTIMATORS[name]), recording.samples()
    online = rollout.scan(guarded.step, guarded.init(jax.tree.map(lambda x: x[0], samples)), samples)[1]
    alone = estimation.estimate(ESTIMATORS[name], shorter)
    for answer in (over, online):
        np.testing.assert_allclose(answer.stiffness[PATIENCE + 1 :], alone.stiffness, rtol=1e-9)
        assert int(answer.skipped[-1]) == PATIENCE + 1


@pytest.fixture(scope="module")
def settled(golden):
    """An estimator, two seconds of the paper's recording without a fault, and its answer."""
    estimator = paper_estimator(residual_torque(100.0), basis=paper_basis(2, 1), matched=True, deflection="raw")
    recording = paper_recording(golden, "residual", 3000)
    run = jax.jit(estimation.estimate)
    return lambda changed: run(estimator, changed), recording, run(estimator, recording)


@pytest.mark.statistical
def test_no_outlier_makes_an_answer_known_and_wrong(settled):
    # The fast twin of a thousand logs: one outlier, of 10 to 1e8 times the signal's range, in any signal.
    run, recording, whole = settled
    rng = np.random.default_rng(5)
    for _ in range(40):
        name, place = rng.choice(SIGNALS), int(rng.integers(0, 1900))
        values = np.asarray(getattr(recording, name))
        size = np.ptp(values) * 10.0 ** rng.uniform(1.0, 8.0) * rng.choice([-1.0, 1.0])
        answer = run(recording._replace(**{name: jnp.asarray(values).at[place].add(size)}))
        later = slice(place + 1000, None)
        moved = np.abs(np.asarray(answer.stiffness - whole.stiffness))[later]
        is_wrong = np.asarray(answer.known)[later] & (moved > 2.0 * 1.96 * np.asarray(answer.stiffness_std)[later])
        assert not is_wrong.any(), (name, place, size)
        assert answer.skipped[-1] >= 1
