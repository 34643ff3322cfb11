"""Controllers through the lab: the same commands as for estimators, on the shipped study."""

from __future__ import annotations

import json

import jax
import jax.numpy as jnp
import numpy as np
import pyarrow.parquet as pq
import pytest

from tuning.files.shipped import CONFIGS
from tuning.kinds.damping.problem import DampingProblem
from tuning.kinds.damping.study import DampingStudy
from tuning.kinds.estimation.problem import EstimationProblem
from tuning.problem.interface import problem_of
from tuning.problem.scenarios import draw_scenarios
from tuning.study.base import resolved, to_toml
from tuning.study.loading import load_study
from tuning.study.paths import numeric_paths
from vsajax.rollout import sensitivity

DAMPING = CONFIGS / "studies" / "damping.toml"
SHORT = ("clock.duration=0.6", "scenarios={train=4, held_out=6}")
LEAD, SLOPE = "controller.conic.lead", "controller.conic.slope"
FEW = ("--set", "clock.duration=0.6", "--set", "scenarios={train=4, held_out=6}", "--json", "-q")


@pytest.fixture(scope="module")
def problem() -> DampingProblem:
    study = load_study(DAMPING, SHORT)
    assert isinstance(study, DampingStudy)
    return DampingProblem(study, (LEAD, SLOPE))


@pytest.mark.equivalence
def test_scores_are_those_of_the_motion(problem):
    scenario = jax.tree.map(lambda x: x[2], draw_scenarios(problem.study, "population", 4))
    values = {LEAD: jnp.asarray(0.03), SLOPE: jnp.asarray(8.0)}
    assert set(scenario.numbers) == set(problem.study.population.paths)
    objective, scores = jax.jit(
        lambda own, given: (
            sensitivity.sum_of_squares(problem.residuals(values, own, given, None)),
            problem.outcome(values, own, given).scores,
        )
    )(scenario, problem.given)
    assert float(objective) == pytest.approx(float(scores.log_energy), rel=1e-12)
    # The rule and the robot both make a difference.
    other = jax.tree.map(lambda x: x[3], draw_scenarios(problem.study, "population", 4))
    run = jax.jit(lambda *given: problem.outcome(*given).scores)
    assert run(values, other, problem.given).log_energy != scores.log_energy
    assert run(values | {LEAD: jnp.asarray(0.0)}, scenario, problem.given).log_energy != scores.log_energy


@pytest.mark.contract
def test_a_study_poses_its_own_kind_of_problem():
    assert isinstance(problem_of(load_study(DAMPING)), DampingProblem)
    assert isinstance(problem_of(load_study(CONFIGS / "studies" / "serial.toml")), EstimationProblem)
    paths = numeric_paths(load_study(DAMPING))
    expected = {"plant.actuator.travel_time", "sensor.delay", "impact.impulse", "observer.cutoff", "scorer.band"}
    assert expected < paths.keys()


@pytest.mark.cli
def test_simulate_writes_what_the_link_did(vsajax, tmp_path):
    ended = vsajax("simulate", DAMPING, "-o", tmp_path / "a.parquet", "--set", "clock.duration=0.6", "--json")
    assert (ended.code, ended.err) == (0, "")
    table = pq.read_table(tmp_path / "a.parquet")
    assert {"time", "link_position", "true_stiffness", "commanded_stiffness"} <= set(table.column_names)
    stiffness = table["true_stiffness"].to_numpy()
    assert (stiffness[0], len(stiffness)) == (0.3, 601)
    assert stiffness.max() <= 1.0
    assert (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"
    assert load_study(tmp_path / "a.toml").kind == "damping"


@pytest.mark.slow(
    twin=(
        "tests/vsajax/experiments/test_damping.py::test_log_energy_in_lead_slope_and_sharpness_matches_finite_differences",
        "tests/tuning/test_golden_runs.py::test_a_finished_run_stays_as_it_is_to_the_bit",
    )
)
@pytest.mark.cli
def test_gradient_tuning_finds_anticipation(vsajax, tmp_path):
    words = ("--set", "tune.starts=1", "--budget", "1", "--set", "tune.max_steps=6", "--seed", "1")
    sized = (*FEW[:2], "--set", "scenarios={train=16, held_out=64}", "--json", "-q")
    ended = vsajax("tune", DAMPING, "-o", tmp_path / "t", *sized, *words)
    assert (ended.code, ended.err) == (0, "")
    result = json.loads(ended.out)
    assert result["held_out"]["mean"] < 0.97 * result["before_on_held_out"]["mean"]
    assert set(result["values"]) == {LEAD, SLOPE, "controller.sharpness"}
    tuned = load_study(tmp_path / "t" / "best.toml")
    assert numeric_paths(tuned)[LEAD] == pytest.approx(result["values"][LEAD])


@pytest.mark.cli
@pytest.mark.slow(
    twin="tests/tuning/test_golden_runs.py::test_an_unfinished_run_goes_on_to_the_results_that_it_would_have_had"
)
def test_sweep_and_montecarlo_run_on_controllers(vsajax, tmp_path):
    swept = vsajax("sweep", DAMPING, "-o", tmp_path / "s", "--scenarios", "4", "--grid", f"{LEAD}=0,0.03", *FEW)
    assert (swept.code, swept.err) == (0, "")
    assert [row["configuration"] for row in json.loads(swept.out)["best"]] in ([0, 1], [1, 0])
    ran = vsajax("montecarlo", DAMPING, "-o", tmp_path / "m", "--scenarios", "32", *FEW)
    assert (ran.code, ran.err) == (0, "")
    summary = json.loads(ran.out)
    assert summary["status"] == {"scored": 32}
    assert set(summary["quantiles"]) >= {"settling_time", "log_energy", "residual"}
    assert "msrep" not in summary["quantiles"]


@pytest.mark.slow(
    twin=(
        "tests/tuning/test_golden_runs.py::test_an_unfinished_run_goes_on_to_the_results_that_it_would_have_had",
        "tests/tuning/test_golden_runs.py::test_a_report_says_what_the_run_found",
    )
)
@pytest.mark.cli
def test_compare_and_report_run_on_controllers(vsajax, tmp_path):
    tables = resolved(load_study(DAMPING)) | {"controller": {"type": "constant", "stiffness": 1.0}}
    (tmp_path / "stiff.toml").write_text(to_toml(tables | {"sweep": {}, "tune": {}}))
    ended = vsajax("compare", DAMPING, tmp_path / "stiff.toml", "-s", DAMPING, "-o", tmp_path / "c", *FEW)
    assert (ended.code, ended.err) == (0, "")
    first, second = json.loads(ended.out)["configs"]
    assert (first["scenarios"], second["scenarios"]) == (6, 6)
    assert second["difference"] == pytest.approx(second["mean"] - first["mean"])
    assert vsajax("montecarlo", DAMPING, "-o", tmp_path / "m", "--scenarios", "32", *FEW).code == 0
    reported = vsajax("report", tmp_path / "m", "--json")
    assert (reported.code, reported.err) == (0, "")


@pytest.mark.failure
@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (["plant.actuator.soft=2.0"], "soft must be below stiff; got 2.0 and 1.0"),
        (["impact.impulse=0.0"], "nothing would move"),
        (["tune.objective=msrep"], "which a study of kind 'damping' does not score"),
        (["clock.jitter_std=1e-4"], "a controller's clock is regular"),
        (["controller.typ=smooth"], "controller.typ"),
        (["controller.sharpness=-1.0"], "controller.sharpness"),
        (["population.vary={'sensor.dealy'={type='uniform', low=0.0, high=1e-3}}"], "sensor.delay"),
    ],
)
def test_mistakes_say_what_to_do(settings, said, vsajax):
    words = [word for setting in settings for word in ("--set", setting)]
    ended = vsajax("check", DAMPING, *words)
    assert (ended.code, ended.out) == (2, "")
    assert said in ended.err


@pytest.mark.failure
def test_methods_with_derivatives_refuse_what_has_none(vsajax, tmp_path):
    switch = "controller={type='switch', soft=0.3, stiff=1.0}"
    bounds = "tune.parameters={'controller.rule.lead'={low=0.0, high=0.1, scale='linear'}}"
    common = ("--set", switch, "--set", bounds, "--set", "sweep={}")
    ended = vsajax("tune", DAMPING, "-o", tmp_path / "t", *common)
    assert ended.code == 2
    assert "controller.type: got 'switch', whose score jumps" in ended.err
    ended = vsajax("tune", DAMPING, "-o", tmp_path / "t", "--set", "tune.objective=settling_time")
    assert ended.code == 2
    assert "a staircase, for --method gradient" in ended.err
    assert not (tmp_path / "t").exists()


@pytest.mark.failure
def test_a_controller_estimates_nothing(vsajax, tmp_path):
    ended = vsajax("estimate", tmp_path / "log.csv", "-c", DAMPING, "-o", tmp_path / "e.parquet")
    assert ended.code == 2
    assert "got 'damping', which estimates nothing" in ended.err
    assert np.array_equal(list(tmp_path.iterdir()), [])
