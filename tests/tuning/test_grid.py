"""A grid of scores against the plain loop over its configurations and scenarios."""

from __future__ import annotations

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.tuning.builders import GAIN, PRIOR, SEA, small_serial
from tuning.files.shipped import example_path
from tuning.kinds.estimation.problem import EstimationProblem
from tuning.problem.build import with_leaves
from tuning.problem.scenarios import draw_scenarios
from tuning.scoring.grid import Grid
from tuning.study.loading import load_study
from tuning.study.ranges import Reach
from vsajax import Scores
from vsajax.experiments import estimation

NOISE, BIAS, SPRING = "sensing.motor_torque.noise_std", "sensing.elastic_torque.bias", "joint.spring.linear"
SHARED_MOTION = {GAIN: [100.0, 300.0], PRIOR: [0.1, 1.0, 10.0], NOISE: [1e-3, 1e-2]}
OWN_MOTION = {BIAS: [0.0, 0.1], SPRING: [40.0, 60.0, 90.0]}
SCENARIOS = 3


def small_sea():
    """Return a study with an irregular clock, in which every scenario moves differently."""
    faster = "excitation.motor.frequencies=[3.0, 11.0]"
    return load_study(
        SEA, ["clock.duration=0.2", faster, "estimator.basis.deflection_terms=1", "sweep={}", "tune={}"]
    )


def by_configuration(grid: Grid, scores: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return each score in an array with one axis an axis of the grid, and the scenarios last."""
    shape = [len(values) for values in grid.axes.values()]
    placed = {}
    for name, score in scores.items():
        rows = np.empty((grid.configurations, grid.scenarios))
        rows[grid.configuration_of.reshape(-1)] = score.reshape(-1, grid.scenarios)
        placed[name] = rows.reshape(*shape, grid.scenarios)
    return placed


def looped(problem: EstimationProblem, axes, scenarios: int) -> dict[str, np.ndarray]:
    """Return the same, one configuration and scenario after the other."""

    @eqx.filter_jit
    def run(bench, key) -> Scores:
        truth = estimation.simulate(bench, key=jax.random.fold_in(key, 0), substeps=problem.substeps)
        recording = estimation.measure(bench, truth, key=jax.random.fold_in(key, 1))
        answer = estimation.estimate(bench.estimator, recording)
        return estimation.score_estimate(truth.time, truth.motion.stiffness, answer, scorer=bench.scorer)

    found = []
    for values in itertools.product(*axes.values()):
        leaves = {path: jnp.asarray(value) for path, value in zip(axes, values, strict=True)}
        bench = with_leaves(problem.bench, leaves)
        found += [run(bench, key) for key in draw_scenarios(problem.study, "train", scenarios).key]
    shape = (*(len(values) for values in axes.values()), scenarios)
    return {name: np.array([getattr(s, name) for s in found]).reshape(shape) for name in Scores._fields}


@pytest.fixture(scope="module")
def shared_motion() -> tuple[EstimationProblem, dict[str, np.ndarray]]:
    """A problem with one motion, and its scores on the whole grid."""
    problem = EstimationProblem(small_serial("scorer.warm_up=0.1"), tuple(SHARED_MOTION))
    grid = Grid(problem, SHARED_MOTION, SCENARIOS)
    return problem, by_configuration(grid, grid.evaluate(grid.outer_points))


def assert_same(found, expected):
    assert found.keys() == set(Scores._fields) == expected.keys()
    for name, score in found.items():
        # Rounding of 200 recursive steps, 2e-14 as measured, with room for other compilers.
        np.testing.assert_allclose(score, expected[name], rtol=1e-11, err_msg=name)


@pytest.mark.equivalence
def test_a_grid_with_one_motion_is_the_loop(shared_motion):
    problem, scores = shared_motion
    assert problem.shared_truth is not None
    assert_same(scores, looped(problem, SHARED_MOTION, SCENARIOS))
    # Every axis and every scenario tells: nothing was broadcast that should not be.
    assert len(np.unique(scores["msrep"])) == scores["msrep"].size


@pytest.mark.equivalence
@pytest.mark.slow(
    twin=(
        "test_a_grid_with_one_motion_is_the_loop",
        "tests/tuning/test_montecarlo.py::test_a_scenario_is_its_robot_alone",
    )
)
def test_a_grid_whose_scenarios_move_differently_is_the_loop():
    problem = EstimationProblem(small_sea(), tuple(OWN_MOTION))
    grid = Grid(problem, OWN_MOTION, SCENARIOS)
    scores = by_configuration(grid, grid.evaluate(grid.outer_points))
    assert problem.shared_truth is None
    assert_same(scores, looped(problem, OWN_MOTION, SCENARIOS))
    assert len(np.unique(scores["msrep"])) == scores["msrep"].size


@pytest.mark.equivalence
def test_scores_depend_neither_on_the_order_of_axes_nor_on_how_many_run_at_a_time(shared_motion, monkeypatch):
    problem, scores = shared_motion
    monkeypatch.setattr(EstimationProblem, "lanes", 2)
    turned = Grid(problem, dict(reversed(SHARED_MOTION.items())), SCENARIOS)
    found = by_configuration(turned, turned.evaluate(turned.outer_points))
    assert_same({name: score.transpose(2, 1, 0, 3) for name, score in found.items()}, scores)


@pytest.mark.equivalence
def test_scores_depend_neither_on_how_many_scenarios_there_are_nor_on_how_they_are_split(shared_motion):
    problem, scores = shared_motion
    at = {GAIN: [300.0], NOISE: [1e-3]}
    # One outer point: the scenarios are shared out over the devices instead.
    single = Grid(EstimationProblem(small_serial("scorer.warm_up=0.1", f"{PRIOR}=10.0")), at, 6)
    found = by_configuration(single, single.evaluate(single.outer_points))
    assert_same(
        {name: score[0, 0, :SCENARIOS] for name, score in found.items()},
        {name: score[1, 2, 0] for name, score in scores.items()},
    )
    assert jax.local_device_count() == 1 or single._cut == (1, jax.local_device_count())
    assert problem.study.seed == single.problem.study.seed


def test_configurations_are_numbered_with_the_last_axis_running_fastest():
    grid = Grid(EstimationProblem(small_serial("estimator.matched=false")), SHARED_MOTION, SCENARIOS)
    expected = [
        dict(zip(SHARED_MOTION, values, strict=True)) for values in itertools.product(*SHARED_MOTION.values())
    ]
    assert [grid.values_of(n) for n in range(grid.configurations)] == expected
    assert grid.outer == (PRIOR,)
    assert grid.inner == (GAIN, NOISE)
    assert grid.inner_size == 2 * 2 * SCENARIOS
    for point, numbers in zip(grid.outer_points, grid.configuration_of, strict=True):
        assert [grid.values_of(n)[PRIOR] for n in numbers] == [*point] * 4
    assert sorted(grid.configuration_of.reshape(-1)) == list(range(grid.configurations))


def test_a_grid_without_axes_is_one_configuration():
    grid = Grid(EstimationProblem(small_serial()), {}, SCENARIOS)
    assert grid.configurations == 1
    assert grid.outer_points.shape == (1, 0)
    assert grid.values_of(0) == {}


@pytest.mark.parametrize(
    ("path", "answer"),
    [
        (GAIN, False),
        (NOISE, True),
        (BIAS, True),
        (PRIOR, False),
        ("estimator.velocity.acceleration_variance", False),
        ("sensing.motor_position.noise_std", False),
        ("sensing.deflection.bias", False),
        (SPRING, False),
    ],
)
def test_which_numbers_touch_the_torque_alone(path, answer):
    study = load_study(example_path("serial", "here"))
    assert (Reach.REGRESSORS not in study.reach(path)) == answer


def test_the_observers_gain_touches_the_torque_alone_where_features_do_not_follow_it():
    study = load_study(example_path("serial", "here"), ["estimator.matched=false"])
    assert Reach.REGRESSORS not in study.reach(GAIN)
