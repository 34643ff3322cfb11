"""Every score in every reader: what prints, tabulates, draws and compares scores knows each of the list."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import get_args

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.tuning.test_golden_runs import COMMANDS, LAB
from tuning.kinds.arm.problem import ArmScores
from tuning.kinds.log.problem import LogScores
from tuning.report import tables
from tuning.report.gather import Contestant
from tuning.report.pictures.populations import draw_spread
from tuning.report.pictures.scores import draw_pairs, draw_shares
from tuning.report.pictures.searches import draw_sweep, draw_tuning
from tuning.scoring.summary import has_failed, summarise
from tuning.study.loading import load_study
from tuning.study.population import Population
from tuning.study.scores import ESTIMATES, HANDS, LOGS, SCORES, SWINGS, Objective, Score, time_of
from tuning.study.statistic import Statistic
from vsajax import Scores, SwingScores

FAMILIES = {"serial": ESTIMATES, "damping": SWINGS}
RNG = np.random.default_rng(3)
OBJECTIVES = get_args(get_args(Objective)[0])
"""Those of vsajax; a plug-in's scores may be others."""
each_score = pytest.mark.parametrize("score", SCORES.values(), ids=list(SCORES))


@pytest.fixture
def lab(tmp_path, monkeypatch) -> Path:
    """A copy of the golden folder, whose finished runs tell what they found without computing anything."""
    copied = Path(shutil.copytree(LAB, tmp_path / "lab"))
    monkeypatch.chdir(copied)
    return copied


@pytest.mark.structure
def test_the_list_has_what_a_scenario_ends_with_and_nothing_else():
    # Whether it diverged is no score: then there is none.
    assert {score.name for score in ESTIMATES} == set(Scores._fields) - {"diverged"}
    assert {score.name for score in SWINGS} == set(SwingScores._fields) - {"diverged"}
    assert {score.name for score in HANDS} == set(ArmScores._fields) - {"diverged"}
    assert {score.name for score in LOGS} == set(LogScores._fields) - {"diverged"}
    own = [score for score in SCORES.values() if SCORES.origin(score.name) is None]
    assert own == [*ESTIMATES, *SWINGS, *HANDS, *LOGS]
    assert {score.name for score in own if score.is_objective} == set(OBJECTIVES)
    assert len({score.title for score in SCORES.values()}) == len(SCORES)


@pytest.mark.cli
@pytest.mark.parametrize("kind", FAMILIES)
def test_the_command_and_the_report_show_every_score_of_a_population(kind, lab, vsajax):
    name = f"{kind}-montecarlo"
    command, *words = COMMANDS[name]
    ended = vsajax(command, *words, "-o", f"runs/{name}", "--resume")
    assert (ended.code, ended.err) == (0, "")
    found = summarised(kind)
    tabulated = {str(row[0]): row for row in tables.tabulate_quantiles(found).rows}
    assert tabulated.keys() == {score.title for score in FAMILIES[kind]}
    for score in FAMILIES[kind]:
        median = found.quantiles[score.name][0.5]
        assert tables.bracketed(median) in tabulated[score.title]
        has_value = not np.isnan(median.value)
        unit = f" [{score.unit}]" if score.unit else ""
        line = f"\n{score.name}{unit} "
        assert (line in ended.out) == (score.is_shown and has_value), line


def columns_of(kind: str) -> dict[str, np.ndarray]:
    table = pq.read_table(LAB / "runs" / f"{kind}-montecarlo" / "results.parquet")
    return {name: table[name].to_numpy() for name in table.column_names}


def summarised(kind: str):
    study = load_study(LAB / "studies" / f"{kind}.toml")
    return summarise(columns_of(kind), None, study.population, (), study.tune.objective, 2)


@each_score
def test_a_score_is_counted_compared_and_named_in_the_tables_of_a_report(score: Score):
    first = RNG.lognormal(size=12)
    pair = [Contestant(name, None, {score.name: values}) for name, values in (("a", first), ("b", 2.0 * first))]
    (row,) = tables.tabulate_scores(pair, 0, Statistic()).rows
    assert row[:2] == [score.title, pytest.approx(first.mean())]
    (row,) = tables.tabulate_differences(*pair, Statistic(), 0).rows
    # Twice as much is better in every scenario, or in none.
    assert (row[0], row[-2]) == (score.title, "100" if score.better == "high" else "0")


@each_score
def test_a_population_can_fail_by_a_score(score: Score):
    population = Population.model_validate({"failures": {"bad": f"{score.name} > 1"}})
    count = 8
    columns = {"scenario": np.arange(count), "status": np.zeros(count, int)}
    columns |= {name: np.ones(count) for name in SCORES} | {score.name: np.arange(count) / 2.0}
    assert has_failed(columns, "bad", population.failures["bad"]).sum() == 5
    found = summarise(columns, None, population, (), "msrep", 2)
    assert found.failures["bad"].value == 5 / 8
    assert [said for said in found.sentences if f"bad ({score.name} > 1{score.suffix})" in said]


@each_score
def test_a_score_is_on_the_axes_of_pictures(score: Score):
    values = RNG.lognormal(size=30)
    assert draw_shares({"all": values}, score.name).axes[0].get_xlabel() == score.title
    axis = draw_pairs(values, values, ("a", "b"), score.name).axes[0]
    assert (axis.get_xlabel(), axis.get_ylabel()) == (f"a: {score.title}", f"b: {score.title}")


@pytest.mark.parametrize("objective", OBJECTIVES)
def test_an_objective_is_on_the_axes_of_what_searches_draw(objective):
    score, values = SCORES[objective], RNG.lognormal(size=30)
    time = time_of(objective)
    assert (time is None) == (score in (*HANDS, *LOGS))
    assert time is None or SCORES[time].is_time
    assert draw_tuning({"before": values, "tuned": values}, objective).axes[0].get_xlabel() == score.title
    ranked = [{"configuration": i, "mean": 1.0 + i} for i in range(3)]
    assert score.title in draw_sweep(ranked, {"a.b": [1.0, 2.0, 3.0]}, objective).axes[0].get_ylabel()
    kind = next((kind for kind, family in FAMILIES.items() if score in family), None)
    if kind is None:
        return  # Told level by level, or of one scenario: nothing is spread out.
    study = load_study(
        LAB / "studies" / f"{kind}.toml",
        [f"tune.objective={objective}", "scorer.warm_up=0.1"]
        if kind == "serial"
        else [f"tune.objective={objective}"],
    )
    axes = draw_spread(columns_of(kind), study, summarised(kind)).axes
    assert [axis.get_xlabel() for axis in axes] == list(dict.fromkeys([score.title, SCORES[time].title]))
