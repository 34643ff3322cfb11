"""A study made computable: noise draws, integration steps, and which motions are shared."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.tuning.builders import GAIN, PRIOR, SEA, small_serial
from tuning.build import with_leaves
from tuning.problem import Problem, scenario_keys
from tuning.study import load_study
from vsajax import plants

SHORT_SEA = ("clock.duration=0.2", "sweep={}", "tune={}")


def draws(study, stream, count) -> np.ndarray:
    return np.asarray(jax.random.key_data(scenario_keys(study, stream, count)))


@pytest.mark.equivalence
def test_a_scenario_is_the_same_however_many_are_drawn():
    study = small_serial()
    for stream in ("train", "held_out"):
        np.testing.assert_array_equal(draws(study, stream, 3), draws(study, stream, 100)[:3])


def test_no_scenario_is_in_both_streams_or_twice_and_each_seed_has_its_own():
    first, second = small_serial(), small_serial("seed=1")
    every = [draws(study, stream, 300) for study in (first, second) for stream in ("train", "held_out")]
    assert len(np.unique(np.concatenate(every), axis=0)) == 4 * 300


def test_integration_steps_are_the_studys_where_it_gives_them():
    assert Problem(small_serial("substeps=7")).substeps == 7


@pytest.mark.analytic
@pytest.mark.parametrize("amplitude", [-8.0, 400.0])
def test_integration_steps_resolve_the_stiffest_moment_of_the_motion(amplitude):
    problem = Problem(small_serial(f"excitation.setpoint_motor.amplitude={amplitude}"))
    motion = problem.shared_truth.motion
    fastest = float(jnp.max(problem.bench.joint.fastest_rate(motion.stiffness)))
    assert problem.substeps == plants.substeps_for(fastest, 1e-3)
    # By the definition of `substeps_for`: ω h is at most 0.025.
    assert fastest * 1e-3 / problem.substeps <= 0.025


def test_a_joint_that_stiffens_along_the_way_gets_more_steps_than_its_start_asks_for():
    mild, strong = (Problem(small_serial(f"excitation.setpoint_motor.amplitude={a}")) for a in (0.0, 400.0))
    assert strong.substeps > mild.substeps


@pytest.mark.failure
def test_a_joint_that_diverges_is_refused_with_a_way_out():
    # A softening spring pushed past its summit has no way back.
    study = load_study(SEA, [*SHORT_SEA, "joint.spring.cubic=-1e6", "excitation.motor.amplitudes=[50.0, 0.0]"])
    with pytest.raises(FloatingPointError, match=r"diverges with \d+ integration steps.*substeps.*in the study"):
        _ = Problem(study).substeps


def test_what_does_not_move_the_joint_shares_one_motion():
    problem = Problem(small_serial(), (GAIN, PRIOR, "sensing.motor_torque.noise_std"))
    assert problem.shares_motion
    keys = scenario_keys(problem.study, "train", 2)
    first, second = (problem.record(problem.bench, key, problem.shared_truth)[1] for key in keys)
    np.testing.assert_array_equal(first.link_position, second.link_position)
    assert (first.motor_torque != second.motor_torque).all()


def test_a_jittered_clock_gives_every_scenario_its_own_motion():
    problem = Problem(load_study(SEA, SHORT_SEA))
    assert problem.shared_truth is None
    keys = scenario_keys(problem.study, "train", 2)
    first, second = (problem.record(problem.bench, key, None)[0] for key in keys)
    assert (first.time[1:] != second.time[1:]).all()
    assert not jnp.allclose(first.motion.link_position, second.motion.link_position, rtol=1e-6)


@pytest.mark.parametrize("path", ["joint.link.inertia", "excitation.motor.amplitude"])
def test_what_moves_the_joint_gives_every_value_its_own_motion(path):
    problem = Problem(small_serial(), (path,))
    assert problem.shared_truth is None
    (key,) = scenario_keys(problem.study, "train", 1)
    other = with_leaves(problem.bench, {path: jnp.asarray(0.4)})
    own, changed = (problem.record(bench, key, None)[0].motion for bench in (problem.bench, other))
    assert not jnp.allclose(own.deflection[1:], changed.deflection[1:], rtol=1e-2)


@pytest.mark.equivalence
@pytest.mark.parametrize("objective", ["msrep", "msrep_settled"])
def test_the_squared_norm_of_the_residuals_is_the_score(objective):
    study = small_serial("scorer.warm_up=0.1", f"tune={{objective='{objective}'}}")
    problem = Problem(study)
    values = {GAIN: jnp.asarray(200.0), PRIOR: jnp.asarray(0.5)}
    (key,) = scenario_keys(study, "train", 1)
    residuals = problem.residuals(values, key, problem.shared_truth)
    score = getattr(problem.scores(values, key, problem.shared_truth), objective)
    # Sums of 200 squares in another order.
    np.testing.assert_allclose(residuals @ residuals, score, rtol=200 * 2.0**-52)
    assert (np.count_nonzero(residuals) < 110) == (objective == "msrep_settled")
