"""The antagonistic joint through the lab: integration steps, tuning the window, both families side by side."""

from __future__ import annotations

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.tuning.builders import ANTAGONISTIC, RESIDUAL_PAIR, WINDOW, scenarios_of, small_antagonistic
from tuning.kinds.estimation.problem import EstimationProblem
from tuning.scoring.grid import Grid
from tuning.search.refine import Search
from tuning.study.loading import load_study

R2 = (
    "excitation.motor1={type='sine', amplitude=3.0, frequency=0.5}",
    "excitation.motor2={type='sine', amplitude=-3.0, frequency=0.7}",
)


def radau(offsets, amplitudes, time: np.ndarray) -> np.ndarray:
    """Return q_L, q₁, q₂ of (1)–(3) with f = 10 φ³."""

    def torque(t: float) -> list[float]:
        return [o + a * np.sin(2 * np.pi * f * t) for o, a, f in zip(offsets, amplitudes, (0.5, 0.7), strict=True)]

    def rates(t: float, x: np.ndarray) -> list[float]:
        link, first, second, *v = x
        f1, f2 = 10.0 * (link - first) ** 3, 10.0 * (link - second) ** 3
        t1, t2 = torque(t)
        pulls = (
            (-0.0127 * v[0] - f1 - f2) / 0.0179,
            (t1 - 1.27 * v[1] + f1) / 1e-4,
            (t2 - 1.27 * v[2] + f2) / 1e-4,
        )
        return [*v, *pulls]

    return solve_ivp(rates, (0.0, time[-1]), np.zeros(6), "Radau", time, rtol=1e-10, atol=1e-12).y[:3]


@pytest.mark.slow(
    twin=(
        "tests/vsajax/plants/test_antagonistic.py::test_motion_is_that_of_radau",
        "tests/tuning/test_problem.py::test_integration_steps_keep_every_position_within_the_tolerance",
    )
)
@pytest.mark.oracle
@pytest.mark.parametrize(
    ("settings", "offsets", "amplitudes"), [((), (2.5, -2.5), (1.5, 1.5)), (R2, (0.0, 0.0), (3.0, -3.0))]
)
def test_chosen_step_follows_radau_to_the_studys_tolerance(settings, offsets, amplitudes):
    study = load_study(ANTAGONISTIC, [*settings, "sweep={}", "tune={}"])
    motion = EstimationProblem(study).shared_truth.motion
    found = np.stack([motion.link_position, motion.motor1_position, motion.motor2_position])
    exact = radau(offsets, amplitudes, np.arange(10001) * 1e-3)
    np.testing.assert_allclose(found, exact, rtol=0.0, atol=study.integration_tolerance)


@pytest.mark.slow(twin="tests/vsajax/estimators/test_algebraic.py::test_error_is_differentiable_in_the_window")
@pytest.mark.gradient
def test_error_is_continuous_in_the_window():
    problem = EstimationProblem(small_antagonistic(), (WINDOW,))
    key, given = scenarios_of(problem.study, "train", 1)[0], problem.given

    @jax.jit
    def error(window: jax.Array) -> jax.Array:
        return problem.outcome({WINDOW: window}, key, given).scores.mse_settled

    # A whole number of samples: just above it one sample less lies a whole window after the start.
    below, at, above = (float(error(jnp.asarray(0.3 + shift))) for shift in (-1e-9, 0.0, 1e-9))
    assert below == pytest.approx(at, rel=1e-6)
    assert above == pytest.approx(at, rel=1e-6)


@pytest.mark.slow(
    twin=(
        "tests/vsajax/estimators/test_algebraic.py::test_error_is_differentiable_in_the_window",
        "tests/tuning/test_gradient.py::test_every_algorithm_leads_down_within_the_bounds",
    )
)
@pytest.mark.gradient
def test_gradient_finds_the_window_from_both_sides():
    study = load_study(ANTAGONISTIC, ["sweep={}", f"tune.parameters={{'{WINDOW}'={{low=0.05, high=2.0}}}}"])
    windows = list(np.geomspace(0.05, 2.0, 40))
    grid = Grid(EstimationProblem(study, (WINDOW,)), {WINDOW: windows}, study.scenarios.train)
    best = grid.evaluate(grid.outer_points)["msrep_settled"].mean(axis=2).min()
    tuner = Search(study, "gradient").tuner
    for start in (0.08, 1.8):
        assert tuner.run({WINDOW: start}).objective <= 1.05 * best


@pytest.mark.cli
@pytest.mark.slow(
    twin="tests/tuning/test_golden_runs.py::test_an_unfinished_run_goes_on_to_the_results_that_it_would_have_had"
)
def test_both_families_are_compared_scenario_by_scenario(vsajax, tmp_path):
    words = ["--set", "clock.duration=2.5", "--scenarios", "6", "--json", "-q"]
    ended = vsajax("compare", ANTAGONISTIC, RESIDUAL_PAIR, "-s", ANTAGONISTIC, "-o", tmp_path / "duel", *words)
    assert (ended.code, ended.err) == (0, "")
    first, second = json.loads(ended.out)["configs"]
    assert first["scenarios"] == second["scenarios"] == 6
    assert second["difference"] == pytest.approx(second["mean"] - first["mean"])
    assert second["difference_low"] < second["difference"] < second["difference_high"]
    assert second["wins"] in {i / 6 for i in range(7)}
