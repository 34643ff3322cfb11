"""Tuning on a study with one coefficient: what is found, judged, written, and not computed again."""

from __future__ import annotations

import math
import os

import jax.numpy as jnp
import numpy as np
import pytest

from tests.tuning.builders import FORGETTING, PRIOR, tiny_tuning
from tuning.errors import InputError
from tuning.gradient import GradientTuner, Outcome
from tuning.grid import Grid
from tuning.problem import Problem, scenario_keys
from tuning.study import load_study, numeric_paths, resolved, study_hash
from tuning.tune import Judgement, Search, Tuned, plan_search, tune

METHODS = ["gradient", "grid", "hybrid"]
CHUNKS = {method: ["screen", "start-000", "start-001"] for method in METHODS} | {"grid": ["screen"]}


@pytest.fixture(scope="module", params=METHODS)
def run(request, tmp_path_factory):
    """A finished search of each method: what was searched, what was found, and where it is."""
    search = Search(tiny_tuning(), request.param)
    folder = tmp_path_factory.mktemp(request.param) / "run"
    return search, tune(search, folder, quiet=True), folder


def unjudged(monkeypatch) -> None:
    """Take the judging away, which is no chunk of the run and compiles programs of its own."""
    blank = Judgement(1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0, 1, np.ones(1))
    monkeypatch.setattr(Search, "judge", lambda *_: blank)


def test_a_search_finds_better_numbers_within_the_bounds(run):
    search, tuned, _ = run
    assert set(tuned.values) == {PRIOR, FORGETTING}
    for path, bounds in search.study.tune.parameters.items():
        assert bounds.low <= tuned.values[path] <= bounds.high
    # The study's own numbers were made bad: a short memory.
    assert tuned.held_out.mean < 0.8 * tuned.before.mean
    assert tuned.train.mean <= min([o.objective for o in tuned.outcomes], default=math.inf) * (1 + 1e-9)


def test_the_best_is_a_study_that_says_where_it_comes_from(run):
    search, tuned, folder = run
    best = load_study(folder / "best.toml")
    assert numeric_paths(best) == numeric_paths(search.study) | tuned.values
    assert {**resolved(best), "provenance": {}} == {
        **resolved(search.study),
        "estimator": resolved(best)["estimator"],
    }
    source = best.provenance
    assert {key: source[key] for key in ("command", "method", "algorithm", "seed", "study_hash", "tuned")} == {
        "command": "tune",
        "method": search.method,
        "algorithm": "levenberg-marquardt",
        "seed": 0,
        "study_hash": study_hash(search.study),
        "tuned": [FORGETTING, PRIOR],
    }
    assert "jax" in source["versions"]
    for name in ("train", "held_out"):
        written, judged = source[name], getattr(tuned, name)
        assert written["mean"] == judged.mean
        assert written["scenarios"] == getattr(search.study.scenarios, name)
        assert judged.low < judged.mean < judged.high
    assert source["before_on_held_out"]["mean"] == tuned.before.mean


def test_every_screening_and_start_is_a_chunk_of_the_run(run):
    search, _, folder = run
    assert sorted(path.stem for path in (folder / "chunks").iterdir()) == CHUNKS[search.method]
    assert sorted(os.listdir(folder)) == ["best.toml", "chunks", "manifest.json", "results.parquet"]


@pytest.mark.equivalence
def test_a_finished_search_is_read_back_and_nothing_is_computed_again(run, monkeypatch):
    search, tuned, folder = run
    unjudged(monkeypatch)

    def refuse(*_):
        raise AssertionError("computed again")

    monkeypatch.setattr(Search, "screen", refuse)
    monkeypatch.setattr(GradientTuner, "run", refuse)
    before = (folder / "results.parquet").read_bytes()
    again = tune(Search(tiny_tuning(), search.method), folder, resume=True, quiet=True)
    assert again.values == tuned.values
    assert again.outcomes == tuned.outcomes
    assert (folder / "results.parquet").read_bytes() == before


@pytest.mark.equivalence
def test_an_interrupted_search_goes_on_with_the_start_that_is_missing(monkeypatch, tmp_path):
    unjudged(monkeypatch)
    asked = []

    def solve(_self: GradientTuner, start: dict[str, float]) -> Outcome:
        asked.append(start)
        if len(asked) == 2:
            raise KeyboardInterrupt
        return Outcome(start, start | {PRIOR: 0.5 * start[PRIOR]}, 1.0 / len(asked), 7, "converged")

    monkeypatch.setattr(GradientTuner, "run", solve)
    monkeypatch.setattr(Search, "screen", lambda _, points: points[:, 0])
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
@pytest.mark.parametrize("objective", ["msrep", "msrep_settled"])
def test_the_screening_and_the_gradient_see_one_objective(objective):
    search = Search(tiny_tuning("scorer.warm_up=0.05", f"tune.objective='{objective}'"), "gradient")
    points = np.array([[0.5, 0.95], [5.0, 0.9]])
    starts = [{PRIOR: jnp.asarray(p), FORGETTING: jnp.asarray(f)} for p, f in points]
    values = [
        search.tuner.objective(search.space.unconstrain(start), search.problem.shared_truth) for start in starts
    ]
    # Sums of 200 squares in two orders, at numbers that came through exp and log.
    np.testing.assert_allclose(search.screen(points), values, rtol=1e-9)


@pytest.mark.equivalence
def test_a_judgement_is_of_the_scores_on_its_stream():
    search = Search(tiny_tuning(), "gradient")
    judged = search.judge({PRIOR: 2.0, FORGETTING: 0.95}, "held_out", 5)
    study = tiny_tuning(f"{PRIOR}=2.0", f"{FORGETTING}=0.95")
    scores = Grid(Problem(study), {}, 5, "held_out").evaluate(np.empty((1, 0)))["msrep"][0, 0]
    np.testing.assert_allclose(judged.msrep, scores, rtol=1e-12)
    assert judged.mean == pytest.approx(scores.mean(), rel=1e-12)
    assert judged.median == pytest.approx(np.median(scores), rel=1e-12)
    assert scores.min() < judged.low < judged.mean < judged.high < scores.max()
    assert (judged.diverged, judged.scenarios) == (0, 5)
    assert "msrep" not in judged.summary()
    assert len(np.unique(scores)) == 5
    assert len(scenario_keys(study, "held_out", 5)) == 5


def test_a_judgement_of_nothing_but_diverged_scenarios_has_no_mean_and_says_so():
    # A covariance that overflows at the first sample.
    judged = Search(tiny_tuning(), "gradient").judge({PRIOR: 1e308, FORGETTING: 0.9}, "held_out", 3)
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
