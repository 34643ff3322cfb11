"""A study made computable: noise draws, integration steps, and which motions are shared."""

from __future__ import annotations

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.tuning.builders import GAIN, PRIOR, SEA, scenarios_of, small_serial
from tuning.files.errors import InputError
from tuning.kinds.estimation.problem import EstimationProblem, Given
from tuning.kinds.estimation.substeps import try_substeps
from tuning.problem.build import with_leaves
from tuning.problem.scenarios import draw_scenarios
from tuning.study.loading import load_study
from vsajax.rollout import sensitivity

SHORT_SEA = ("clock.duration=0.2", "sweep={}", "tune={}")


def draws(study, stream, count) -> np.ndarray:
    return np.asarray(jax.random.key_data(draw_scenarios(study, stream, count).key))


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
    assert EstimationProblem(small_serial("substeps=7")).substeps == 7


@pytest.mark.oracle
@pytest.mark.parametrize("tolerance", [1e-5, 1e-7])
def test_integration_steps_keep_every_position_within_the_tolerance(tolerance):
    problem = EstimationProblem(
        small_serial(f"integration_tolerance={tolerance}", "excitation.setpoint_motor.amplitude=400.0")
    )
    motion, exact = problem.shared_truth.motion, try_substeps(problem.bench, 512).truth.motion
    for name in ("link_position", "motor_position", "setpoint_position"):
        np.testing.assert_allclose(getattr(motion, name), getattr(exact, name), rtol=0.0, atol=tolerance)


@pytest.mark.slow(twin="test_integration_steps_keep_every_position_within_the_tolerance")
def test_a_tighter_tolerance_and_a_stiffer_moment_ask_for_more_steps():
    tight, mild, strong = (
        EstimationProblem(small_serial(*settings)).substeps
        for settings in (
            ["integration_tolerance=1e-9"],
            ["excitation.setpoint_motor.amplitude=0.0"],
            ["excitation.setpoint_motor.amplitude=400.0"],
        )
    )
    assert tight > mild
    assert strong > mild


@pytest.mark.failure
def test_a_joint_that_diverges_is_refused_with_a_way_out():
    # A softening spring pushed past its summit has no way back.
    study = load_study(SEA, [*SHORT_SEA, "joint.spring.cubic=-1e6", "excitation.motor.amplitudes=[50.0, 0.0]"])
    with pytest.raises(InputError, match=r"diverges, even with 1024 integration steps.*\n.*check its springs"):
        _ = EstimationProblem(study).substeps


@pytest.mark.failure
def test_a_joint_that_asks_for_too_many_steps_is_refused():
    with pytest.raises(InputError, match=r"asks for about \d+ integration steps a sample.*limit is 1024"):
        _ = EstimationProblem(small_serial("joint.link.inertia=1e-12")).substeps


@pytest.mark.failure
def test_an_unstable_number_of_steps_is_refused_with_the_largest_safe_step():
    stiff = "joint.spring.spring_rate=1e8"
    with pytest.raises(InputError, match=r"substeps: got 1: .*unstable above .* s\n.*at least (\d+)") as caught:
        _ = EstimationProblem(small_serial("substeps=1", stiff)).substeps
    least = int(re.search(r"at least (\d+)", str(caught.value))[1])
    assert EstimationProblem(small_serial(f"substeps={least}", stiff)).substeps == least
    with pytest.raises(InputError, match="unstable"):
        _ = EstimationProblem(small_serial(f"substeps={least - 1}", stiff)).substeps


def test_what_does_not_move_the_joint_shares_one_motion():
    problem = EstimationProblem(small_serial(), (GAIN, PRIOR, "sensing.motor_torque.noise_std"))
    assert problem.shares_motion
    keys = scenarios_of(problem.study, "train", 2)
    first, second = (problem.record(key, problem.given)[1] for key in keys)
    np.testing.assert_array_equal(first.link_position, second.link_position)
    assert (first.motor_torque != second.motor_torque).all()


def test_a_jittered_clock_gives_every_scenario_its_own_motion():
    problem = EstimationProblem(load_study(SEA, SHORT_SEA))
    assert problem.shared_truth is None
    keys = scenarios_of(problem.study, "train", 2)
    first, second = (problem.record(key, problem.given)[0] for key in keys)
    assert (first.time[1:] != second.time[1:]).all()
    assert not jnp.allclose(first.motion.link_position, second.motion.link_position, rtol=1e-6)


@pytest.mark.parametrize("path", ["joint.link.inertia", "excitation.motor.amplitude"])
def test_what_moves_the_joint_gives_every_value_its_own_motion(path):
    problem = EstimationProblem(small_serial(), (path,))
    assert problem.shared_truth is None
    (key,) = scenarios_of(problem.study, "train", 1)
    other = with_leaves(problem.bench, {path: jnp.asarray(0.4)})
    own, changed = (problem.record(key, Given(bench, None))[0].motion for bench in (problem.bench, other))
    assert not jnp.allclose(own.deflection[1:], changed.deflection[1:], rtol=1e-2)


@pytest.mark.equivalence
@pytest.mark.parametrize("objective", ["msrep", "msrep_settled"])
def test_the_squared_norm_of_the_residuals_is_the_score(objective):
    study = small_serial("scorer.warm_up=0.1", f"tune={{objective='{objective}'}}")
    problem = EstimationProblem(study)
    values = {GAIN: jnp.asarray(200.0), PRIOR: jnp.asarray(0.5)}
    (key,) = scenarios_of(study, "train", 1)
    observed = problem.observe(values, key, problem.given)
    residuals = sensitivity.run(problem.residuals(values, key, problem.given, observed))
    score = getattr(problem.outcome(values, key, problem.given).scores, objective)
    # Sums of 200 squares in another order.
    np.testing.assert_allclose(residuals @ residuals, score, rtol=200 * 2.0**-52)
    assert (np.count_nonzero(residuals) < 110) == (objective == "msrep_settled")
