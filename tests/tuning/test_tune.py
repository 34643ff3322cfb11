"""Tuning on a study with one coefficient: what is found, judged, written, and not computed again."""

from __future__ import annotations

import json
import math
import os

import jax.numpy as jnp
import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.tuning.builders import FORGETTING, GAIN, PRIOR, RESIDUAL, tiny_tuning
from tuning.files.errors import InputError
from tuning.kinds.estimation.problem import EstimationProblem
from tuning.scoring.grid import Grid
from tuning.scoring.intervals import Judgement
from tuning.search.least_squares import GradientTuner, Outcome
from tuning.search.refine import Search, Tuned, plan_search, tune
from tuning.study.base import resolved, study_hash
from tuning.study.loading import load_study
from tuning.study.paths import numeric_paths

METHODS = {"gradient": 2, "grid": 0, "hybrid": 2}
"""Starts of each method."""


@pytest.fixture
def unjudged(monkeypatch) -> None:
    """Take the judging away, which is no chunk of the run and compiles programs of its own."""
    blank = Judgement("mean", *[1.0] * 13, 0, 1, np.ones(1))
    monkeypatch.setattr(Search, "judge", lambda *_: blank)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.usefixtures("unjudged")
def test_a_search_ends_with_the_best_of_what_it_tried_and_is_not_computed_again(method, monkeypatch, tmp_path):
    search, folder = Search(tiny_tuning(), method), tmp_path / "run"
    tuned = tune(search, folder, quiet=True)
    starts = [f"start-{i:03d}" for i in range(METHODS[method])]
    assert json.loads((folder / "manifest.json").read_text())["chunks"] == ["screen", *starts]
    assert sorted(os.listdir(folder)) == ["best.toml", "chunks", "manifest.json", "results.parquet"]
    tried = pq.read_table(folder / "results.parquet").to_pylist()
    assert len(tried) == {"gradient": 4, "grid": 15, "hybrid": 15}[method] + len(starts)
    best = min(tried, key=lambda row: row["objective"])
    assert tuned.values == {path: best[path] for path in (PRIOR, FORGETTING)}
    for path, bounds in search.study.tune.parameters.items():
        assert all(bounds.low <= row[path] <= bounds.high for row in tried)
    # The first start is the study itself, the second the best that was screened: neither may end worse.
    assert [outcome.start for outcome in tuned.outcomes[:1]] == [search.own][: len(starts)]
    assert numeric_paths(load_study(folder / "best.toml")) == numeric_paths(search.study) | tuned.values

    def refuse(*_):
        raise AssertionError("computed again")

    monkeypatch.setattr(Search, "screen", refuse)
    monkeypatch.setattr(GradientTuner, "run", refuse)
    before = (folder / "results.parquet").read_bytes()
    again = tune(Search(tiny_tuning(), method), folder, resume=True, quiet=True)
    assert again.values == tuned.values
    assert again.outcomes == tuned.outcomes
    assert (folder / "results.parquet").read_bytes() == before


def test_the_best_is_a_study_with_its_scores_and_where_it_comes_from(monkeypatch, tmp_path):
    found = {PRIOR: 1.0, FORGETTING: 0.8}
    monkeypatch.setattr(Search, "screen", lambda _, points: 100.0 + points[:, 0])
    monkeypatch.setattr(GradientTuner, "run", lambda _, start: Outcome(start, found, 1.0, 7, "converged"))
    search = Search(tiny_tuning("seed=3"), "gradient")
    tuned = tune(search, tmp_path, quiet=True)
    best = load_study(tmp_path / "best.toml")
    assert numeric_paths(best) == numeric_paths(search.study) | found
    expected = resolved(search.study) | {"estimator": resolved(best)["estimator"]}
    assert resolved(best) | {"provenance": {}} == expected
    source = best.provenance
    assert "jax" in source.pop("versions")
    judged = {name: source.pop(name) for name in ("train", "held_out", "before_on_held_out")}
    assert source == {
        "command": "tune",
        "method": "gradient",
        "algorithm": "levenberg-marquardt",
        "objective": "msrep",
        "statistic": {"kind": "mean", "level": 0.95},
        "seed": 3,
        "study_hash": study_hash(search.study),
        "tuned": [FORGETTING, PRIOR],
        "calibrated": [],
    }
    assert [judged[name]["scenarios"] for name in judged] == [3, 5, 5]
    judgements = {"train": tuned.train, "held_out": tuned.held_out, "before_on_held_out": tuned.before}
    for name, judgement in judgements.items():
        assert judged[name]["mean"] == judgement.mean
        assert judged[name]["low"] < judgement.mean < judged[name]["high"]
    # A shorter memory is better on noise that nobody looked at.
    assert tuned.held_out.mean < tuned.before.mean


@pytest.mark.equivalence
@pytest.mark.usefixtures("unjudged")
def test_an_interrupted_search_goes_on_with_the_start_that_is_missing(monkeypatch, tmp_path):
    asked = []

    def solve(_self: GradientTuner, start: dict[str, float]) -> Outcome:
        asked.append(start)
        if len(asked) == 2:
            raise KeyboardInterrupt
        return Outcome(start, start | {PRIOR: 0.5 * start[PRIOR]}, 1.0 / len(asked), 7, "converged")

    monkeypatch.setattr(GradientTuner, "run", solve)
    monkeypatch.setattr(Search, "screen", lambda _, points: 100.0 + points[:, 0])
    search = Search(tiny_tuning("tune.starts=3"), "gradient")
    with pytest.raises(KeyboardInterrupt):
        tune(search, tmp_path / "run", quiet=True)
    monkeypatch.delattr(Search, "screen")
    tuned: Tuned = tune(search, tmp_path / "run", resume=True, quiet=True)
    own, first, again, second = asked
    assert own == search.own
    assert first == again
    # The screened points follow in the order of their scores, here their first number.
    assert first[PRIOR] < second[PRIOR]
    assert [outcome.start for outcome in tuned.outcomes] == [own, first, second]
    assert [outcome.steps for outcome in tuned.outcomes] == [7, 7, 7]
    assert tuned.values == tuned.outcomes[2].values


@pytest.mark.equivalence
def test_the_screening_and_the_gradient_see_one_objective():
    search = Search(tiny_tuning("scorer.warm_up=0.05", "tune.objective='msrep_settled'"), "gradient")
    points = np.array([[0.5, 0.95], [5.0, 0.9]])
    starts = [{PRIOR: jnp.asarray(p), FORGETTING: jnp.asarray(f)} for p, f in points]
    values = [search.tuner.objective(search.space.unconstrain(start), search.tuner.given) for start in starts]
    # Sums of 200 squares in two orders, at numbers that came through exp and log.
    np.testing.assert_allclose(search.screen(points), values, rtol=1e-9)


@pytest.mark.equivalence
def test_a_judgement_is_of_the_scores_on_its_stream():
    search = Search(tiny_tuning(), "gradient")
    judged = search.judge({PRIOR: 2.0, FORGETTING: 0.95}, "held_out", 5)
    study = tiny_tuning(f"{PRIOR}=2.0", f"{FORGETTING}=0.95")
    scores = Grid(EstimationProblem(study), {}, 5, "held_out").evaluate(np.empty((1, 0)))["msrep"][0, 0]
    np.testing.assert_allclose(judged.each, scores, rtol=1e-12)
    assert judged.mean == pytest.approx(scores.mean(), rel=1e-12)
    assert judged.median == pytest.approx(np.median(scores), rel=1e-12)
    assert scores.min() < judged.low < judged.mean < judged.high < scores.max()
    assert (judged.diverged, judged.scenarios) == (0, 5)
    assert "each" not in judged.summary()
    assert len(np.unique(scores)) == 5


def test_a_judgement_of_nothing_but_diverged_scenarios_has_no_mean_and_says_so():
    # A gain at which the observer's torque overflows.
    bounds = f"tune.parameters={{'{GAIN}' = {{ low = 1.0, high = 100.0 }}}}"
    judged = Search(tiny_tuning(RESIDUAL, bounds), "gradient").judge({GAIN: 1e308}, "held_out", 3)
    assert (judged.diverged, judged.scenarios) == (3, 3)
    assert all(math.isnan(value) for value in (judged.mean, judged.low, judged.high, judged.median, judged.q90))


def test_points_to_screen_fill_the_bounds_and_follow_from_the_seed():
    study = tiny_tuning("tune.screen=50")
    points = Search(study, "gradient").sobol_points()
    assert points.shape == (50, 2)
    for column, bounds in zip(points.T, study.tune.parameters.values(), strict=True):
        shares = np.log(column / bounds.low) / np.log(bounds.high / bounds.low)
        assert ((shares > 0.0) & (shares < 1.0)).all()
        # 50 points of a Sobol sequence of 64: every tenth of the range holds some.
        assert np.histogram(shares, 10, (0.0, 1.0))[0].min() >= 2
    np.testing.assert_array_equal(points, Search(study, "gradient").sobol_points())
    assert (points != Search(tiny_tuning("tune.screen=50", "seed=1"), "gradient").sobol_points()).any()


def test_a_grid_search_screens_every_combination():
    study = tiny_tuning()
    points = Search(study, "grid").grid_points()
    priors, memories = (bounds.grid() for bounds in study.tune.parameters.values())
    assert [tuple(point) for point in points] == [(prior, memory) for prior in priors for memory in memories]


@pytest.mark.failure
def test_a_study_with_nothing_to_tune_is_refused():
    with pytest.raises(InputError, match=r"study\.toml: tune\.parameters: names no number to tune\n.*e\.g\."):
        plan_search(tiny_tuning("tune={}"), "gradient", "bfgs", "study.toml")
