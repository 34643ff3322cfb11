"""Monte Carlo runs: a scenario is the same robot however the run is cut, and can be replayed alone."""

from __future__ import annotations

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.tuning.builders import GAIN, RESIDUAL, SERIAL, SMALL, TINY, tiny_serial
from tuning.kinds.estimation.problem import EstimationProblem
from tuning.problem.interface import Status
from tuning.problem.replay import member, simulate
from tuning.runs.executors import Inline
from tuning.scoring import montecarlo as module
from tuning.scoring.montecarlo import MonteCarlo, run_population
from tuning.scoring.summary import has_failed, probability, quantile
from vsajax import Scores

VARY = (
    "population.vary={'joint.motor.inertia'={type='uniform', low=0.9, high=1.1, relative=true}, "
    "'sensing.motor_torque.noise_std'={type='loguniform', low=1e-3, high=1e-1}, "
    "'sensing.elastic_torque.noise_std'={type='loguniform', low=1e-3, high=1.0}}"
)
FAILURES = "population.failures={late='known_time > 0.1'}"
WORDS = [word for setting in (*SMALL, *TINY, VARY, FAILURES) for word in ("--set", setting)]


def varied(*settings):
    return tiny_serial(VARY, *settings)


@pytest.mark.equivalence
def test_a_scenario_is_the_same_in_chunks_of_any_size(monkeypatch):
    whole = MonteCarlo(varied(), 48)
    assert len(whole.chunks) == 1
    rows = whole.run_chunk("000000")
    monkeypatch.setattr(module, "_STEPS_PER_CHUNK", 16 * whole.problem.samples)
    cut = MonteCarlo(varied(), 40)
    assert cut.chunks == ["000000", "000001", "000002"]
    pieces = [cut.run_chunk(chunk) for chunk in cut.chunks]
    for name, values in rows.items():
        joined = np.concatenate([piece[name] for piece in pieces])
        # Lanes are computed side by side in groups: rounding may differ in the last digit between groups.
        np.testing.assert_allclose(joined, values[:40], rtol=1e-12, err_msg=name)
    assert len(np.unique(rows["msrep"])) == 48


@pytest.mark.equivalence
def test_a_scenario_is_its_robot_alone():
    study = varied()
    rows = MonteCarlo(study, 16).run_chunk("000000")
    for scenario in (0, 11):
        alone = member(study, scenario)
        assert not alone.population.paths
        assert alone.joint.motor.inertia == pytest.approx(rows["joint.motor.inertia"][scenario], rel=1e-15)
        columns, _ = simulate(study, scenario)
        truth = EstimationProblem(alone).shared_truth
        np.testing.assert_allclose(columns["true_stiffness"], truth.motion.stiffness, rtol=1e-9)


@pytest.mark.cli
def test_a_run_reports_and_its_worst_case_is_replayed(vsajax, tmp_path):
    run = tmp_path / "run"
    ended = vsajax(
        "montecarlo", SERIAL, "-o", run, "--scenarios", "64", "--sensitivity", "32", "-q", "--json", *WORDS
    )
    assert (ended.code, ended.err) == (0, "")
    said = json.loads(ended.out)
    table = pq.read_table(run / "results.parquet")
    assert table.num_rows == said["scenarios"] == 64
    assert set(Scores._fields) | {"scenario", "status", "joint.motor.inertia"} <= set(table.column_names)
    assert said["status"] == {"scored": 64}
    assert (
        json.loads((run / "summary.json").read_text())["failures"]["late"]["value"]
        == said["failures"]["late"]["value"]
    )
    # Three numbers, the noise, and the matrices A and B.
    assert pq.read_table(run / "design" / "results.parquet").num_rows == 32 * 6
    assert set(said["influences"]) == {"noise draw", *said["correlations"]}
    # The fit sees the torque sensor alone: its noise is what moves the score, motor torque noise does nothing.
    totals = {name: index["total"]["value"] for name, index in said["influences"].items()}
    assert totals["sensing.motor_torque.noise_std"] == pytest.approx(0.0, abs=1e-12)
    assert totals["sensing.elastic_torque.noise_std"] > 0.01
    assert all((tmp_path / path).stat().st_size for path in said["pictures"])

    worst = said["worst"][0]
    scores = table["msrep"].to_numpy()
    assert worst == int(np.argmax(scores))
    rec = tmp_path / "rec.parquet"
    assert vsajax("simulate", SERIAL, "-o", rec, "--scenario", worst, "-q", *WORDS).code == 0
    replay = vsajax("estimate", rec, "-c", tmp_path / "rec.toml", "-o", tmp_path / "est.parquet", "--json")
    assert json.loads(replay.out)["scores"]["msrep"] == pytest.approx(scores[worst], rel=1e-9)

    again = vsajax("montecarlo", SERIAL, "-o", run, "--scenarios", "64", "--sensitivity", "32", *WORDS)
    assert again.code == 2
    assert "--resume" in again.err


@pytest.mark.equivalence
def test_a_run_stops_once_it_is_precise_and_resumes_to_the_same(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_STEPS_PER_CHUNK", 16 * 201)
    run = MonteCarlo(varied(), 4096)
    loose = run_population(run, tmp_path / "loose", Inline(), precision=0.9, quiet=True)
    assert loose.scenarios < 4096
    tight = run_population(run, tmp_path / "tight", Inline(), precision=5e-4, quiet=True)
    assert loose.scenarios < tight.scenarios
    again = run_population(run, tmp_path / "tight", Inline(), precision=5e-4, resume=True, quiet=True)
    assert repr(again) == repr(tight)


def test_scenarios_that_cannot_be_scored_say_why():
    # A gain at which the observer's torque overflows, in some of the robots.
    vary = f"{{'{GAIN}'={{type='choice', values=[100.0, 1e308]}}}}"
    rows = MonteCarlo(tiny_serial(RESIDUAL, f"population.vary={vary}"), 16).run_chunk("000000")
    strong = rows[GAIN] > 100.0
    np.testing.assert_array_equal(rows["status"] == Status.ESTIMATE_DIVERGED, strong)
    assert strong.any()
    assert not strong.all()

    vary = "{'joint.spring.spring_rate'={type='choice', values=[1.0, 1e4], relative=true}}"
    rows = MonteCarlo(tiny_serial(f"population.vary={vary}", "substeps=2"), 16).run_chunk("000000")
    stiff = rows["joint.spring.spring_rate"] > 1e6
    assert set(rows["status"][stiff]) <= {Status.STEP_TOO_COARSE, Status.MOTION_DIVERGED}
    assert set(rows["status"][~stiff]) == {Status.OK}


def test_steps_are_enough_for_the_stiffest_of_the_robots():
    vary = "population.vary={'joint.spring.spring_rate'={type='uniform', low=1.0, high=100.0, relative=true}}"
    own, population = (EstimationProblem(tiny_serial(*settings)).substeps for settings in ((), (vary,)))
    assert population >= 8 * own


@pytest.mark.slow(
    twin=(
        "tests/tuning/test_robustness.py::test_quantile_intervals_cover_whatever_the_distribution",
        "tests/tuning/test_robustness.py::test_probability_has_the_clopper_pearson_interval",
    )
)
@pytest.mark.statistical
def test_intervals_of_small_studies_cover_the_value_of_a_large_one():
    failing = "population.failures={bad='msrep > 89'}"

    def run(seed: int, scenarios: int) -> dict[str, np.ndarray]:
        planned = MonteCarlo(varied(failing, f"seed={seed}"), scenarios)
        pieces = [planned.run_chunk(chunk) for chunk in planned.chunks]
        return {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}

    large = run(0, 200_000)
    truth = {level: quantile(large["msrep"], level).value for level in (0.5, 0.95)}
    truth["bad"] = float(has_failed(large, "bad", "msrep > 89").mean())
    assert 0.02 < truth["bad"] < 0.98
    # Random draws of another seed: consecutive blocks are independent studies.
    studies, size = 200, 256
    small = run(1, studies * size)
    hits = dict.fromkeys(truth, 0)
    for i in range(studies):
        block = {name: values[i * size : (i + 1) * size] for name, values in small.items()}
        intervals = {level: quantile(block["msrep"], level) for level in (0.5, 0.95)}
        intervals["bad"] = probability(has_failed(block, "bad", "msrep > 89"))
        for name, found in intervals.items():
            hits[name] += found.low <= truth[name] <= found.high
    print({name: hit / studies for name, hit in hits.items()})
    for hit in hits.values():
        assert 0.90 <= hit / studies <= 0.99


@pytest.mark.cli
@pytest.mark.parametrize("settings", [(), ("population.vary={}",)], ids=["a population", "none"])
def test_a_design_repeats_to_the_bit_and_may_have_one_factor(settings, vsajax, tmp_path):
    words = [word for setting in (*SMALL, *TINY, *settings) for word in ("--set", setting)]
    call = ["montecarlo", SERIAL, "--scenarios", "16", "--sensitivity", "16", *words]
    summaries = []
    for run, more in (("one", []), ("two", []), ("two", ["--resume"])):
        ended = vsajax(*call, "-o", tmp_path / run, *more)
        assert (ended.code, ended.err) == (0, "")
        summaries.append((tmp_path / run / "summary.json").read_bytes())
    assert summaries[0] == summaries[1] == summaries[2]
    assert list(json.loads(summaries[0])["influences"]) == ["noise draw"]
