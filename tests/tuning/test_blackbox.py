"""Black-box tuning: what is found, chosen, counted, and repeated after an interruption."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.tuning.builders import FORGETTING, PRIOR, tiny_tuning
from tuning.files.errors import InputError
from tuning.runs.folder import RunStore
from tuning.runs.manifest import read_manifest
from tuning.scoring.intervals import Judgement
from tuning.search import blackbox
from tuning.search.blackbox import BlackBox, Trial, explore, find_front, plan_blackbox, read_trials
from tuning.search.refine import Search, plan_search
from tuning.study.base import Study, resolved
from tuning.study.loading import load_study
from tuning.study.paths import numeric_paths
from vsajax import Scores

BLANK = Judgement("mean", *[1.0] * 13, 0, 1, np.ones(1))
LAW = "estimator.fit.law"


@pytest.fixture
def unjudged(monkeypatch) -> None:
    """Take the judging away, which compiles programs of its own."""
    monkeypatch.setattr(Search, "judge", lambda *_: BLANK)


@pytest.fixture
def bowl(monkeypatch) -> None:
    """Score points by a closed form: a bowl around prior 2 and memory 0.7; a fixed law is worse by 5."""

    def score(search: Search, points: np.ndarray) -> Scores:
        assert len(points) == 8
        ones = np.ones((1, search.study.scenarios.train))
        named = dict(zip(search.paths, points.T, strict=True))
        prior, memory = named[PRIOR], named.get(FORGETTING, np.full(len(points), 0.7))
        worse = 5.0 * (FORGETTING not in named)
        objective = worse + np.log(prior / 2.0) ** 2 + 10.0 * (memory - 0.7) ** 2
        objective = np.where(prior > 9.0, np.nan, objective)
        blank = {name: ones for name in Scores._fields}
        found = {"msrep": objective[:, None] * ones, "convergence_time": prior[:, None] * ones / 100.0}
        return Scores(**(blank | found))

    monkeypatch.setattr(Search, "score", score)


def chosen_laws(*settings: str) -> Study:
    """Return a study that chooses between a forgetting law and a constant factor, which lacks its parameter."""
    rigid = f"{{ '{LAW}' = {{ type = 'constant', factor = 0.9 }} }}"
    return tiny_tuning(f"tune.choices.law={{ memory = {{}}, rigid = {rigid} }}", *settings)


def prior_within(low: float, high: float) -> Study:
    """Return the study with other bounds of the prior; the bowl is not finite above 9."""
    bounds = f"'{PRIOR}' = {{ low = {low}, high = {high} }}, '{FORGETTING}' = {{ low = 0.5, high = 0.999 }}"
    return tiny_tuning(f"tune.parameters={{ {bounds} }}")


def seen(trials: list[Trial]) -> list[str]:
    """Return trials to the last bit, NaN being equal to itself, without what the clock adds."""
    return [repr(dataclasses.replace(trial, seconds=0.0)) for trial in trials]


@pytest.mark.parametrize("method", ["tpe", "cmaes", "pareto"])
def test_a_better_point_than_the_studys_own_is_found_kept_and_not_computed_again(method, monkeypatch, tmp_path):
    study, folder = tiny_tuning(), tmp_path / "run"
    found = explore(BlackBox(study, method, batch=8), folder, trials=20, quiet=True)
    own = Search(study, "tpe").own
    assert found.trials[0].values == pytest.approx(own)
    assert found.best.objective < found.trials[0].objective
    assert found.tuned.held_out.mean < found.tuned.before.mean
    assert (len(found.trials), found.failed, found.tuned.evaluations) == (20, 0, 20)
    # What the batch is told is what a single point scores.
    alone = Search(study, "tpe").screen(np.array([list(found.best.values.values())]))
    np.testing.assert_allclose(found.best.objective, alone[0], rtol=1e-9)

    best = load_study(folder / "best.toml")
    assert numeric_paths(best) == numeric_paths(study) | found.tuned.values
    source = best.provenance
    assert (source["method"], source["trials"], source["failed"]) == (method, 20, 0)
    rows = pq.read_table(folder / "results.parquet").to_pylist()
    assert [row["number"] for row in rows] == list(range(20))
    assert {row["state"] for row in rows} == {"scored"}
    assert min(row["objective"] for row in rows) == found.best.objective
    assert all(row["seconds"] > 0.0 for row in rows)
    assert sum(row["seconds"] for row in rows) == pytest.approx(found.trials[-1].seconds)
    for path, bounds in study.tune.parameters.items():
        assert all(bounds.low <= row[path] <= bounds.high for row in rows)

    monkeypatch.delattr(Search, "score")
    monkeypatch.setattr(Search, "judge", lambda *_: BLANK)
    again = explore(BlackBox(study, method, batch=8), folder, trials=20, resume=True, quiet=True)
    assert again.trials == found.trials


@pytest.mark.equivalence
@pytest.mark.parametrize("method", ["tpe", "cmaes", "pareto"])
@pytest.mark.parametrize("told", [0, 3])
@pytest.mark.usefixtures("bowl", "unjudged")
def test_a_resumed_search_asks_for_the_same_trials(method, told, monkeypatch, tmp_path):
    box = BlackBox(tiny_tuning("seed=5"), method, batch=8)
    whole = explore(box, tmp_path / "whole", trials=40, quiet=True)
    assert len({tuple(trial.values.values()) for trial in whole.trials}) == 40

    # The process dies in the third batch, when some of its trials are told, and in the middle of a line.
    kept = BlackBox.told
    count = iter(range(1000))

    def told_some(self: BlackBox, score: np.ndarray) -> list[float]:
        if next(count) == 16 + told:
            raise KeyboardInterrupt
        return kept(self, score)

    monkeypatch.setattr(BlackBox, "told", told_some)
    folder = tmp_path / "cut"
    with pytest.raises(KeyboardInterrupt):
        explore(box, folder, trials=40, quiet=True)
    monkeypatch.setattr(BlackBox, "told", kept)
    with (folder / "optuna.log").open("a") as journal:
        journal.write('{"op_code": 5, "user_at')
    (folder / "optuna.log.lock").symlink_to("optuna.log")
    resumed = explore(box, folder, trials=40, resume=True, quiet=True)
    assert seen(resumed.trials) == seen(whole.trials)
    assert [trial.number for trial in resumed.trials] == list(range(40))
    # More trials do not make another run.
    longer = explore(box, folder, trials=48, resume=True, quiet=True)
    assert seen(longer.trials[:40]) == seen(whole.trials)
    assert len(longer.trials) == 48


@pytest.mark.usefixtures("bowl", "unjudged")
def test_another_seed_asks_for_other_trials(tmp_path):
    first, second = (
        explore(BlackBox(tiny_tuning(f"seed={seed}"), "tpe", 8), tmp_path / str(seed), trials=8, quiet=True)
        for seed in (1, 2)
    )
    assert all(a.values != b.values for a, b in zip(first.trials[1:], second.trials[1:], strict=True))


@pytest.mark.usefixtures("bowl", "unjudged")
@pytest.mark.parametrize("method", ["tpe", "cmaes"])
def test_trials_gather_around_the_planted_best(method, tmp_path):
    found = explore(BlackBox(tiny_tuning(), method, batch=8), tmp_path, trials=80, quiet=True)
    assert found.best.objective < 0.05
    later = [trial.objective for trial in found.trials[40:] if trial.is_scored]
    assert np.median(later) < 0.3 * np.median([t.objective for t in found.trials[1:8] if t.is_scored])


@pytest.mark.usefixtures("bowl", "unjudged")
def test_trials_without_a_finite_score_are_counted_and_stayed_away_from(tmp_path):
    study = prior_within(1.0, 100.0)
    found = explore(BlackBox(study, "tpe", batch=8), tmp_path, trials=64, quiet=True)
    failed = [trial.values[PRIOR] > 9.0 for trial in found.trials]
    assert found.failed == sum(failed) > 0
    assert sum(failed[32:]) < sum(failed[:32])
    rows = pq.read_table(tmp_path / "results.parquet").to_pylist()
    assert [row["state"] == "failed" for row in rows] == failed
    assert [math.isnan(row["objective"]) for row in rows] == failed
    assert load_study(tmp_path / "best.toml").provenance["failed"] == found.failed


@pytest.mark.failure
@pytest.mark.usefixtures("bowl", "unjudged")
@pytest.mark.parametrize("method", ["tpe", "cmaes", "pareto"])
def test_a_search_whose_trials_all_fail_says_so(method, tmp_path):
    study = prior_within(10.0, 100.0)
    with pytest.raises(InputError, match=r"none of 24 trials had a finite score\n.*narrow the bounds"):
        explore(BlackBox(study, method, batch=8), tmp_path, trials=24, quiet=True)
    assert pq.read_table(tmp_path / "results.parquet").num_rows == 24


@pytest.mark.usefixtures("bowl", "unjudged")
@pytest.mark.parametrize("method", ["tpe", "pareto"])
def test_the_planted_better_structure_is_chosen(method, tmp_path):
    forgetting = f"{{ '{LAW}' = {{ type = 'forgetting', forgetting = 0.95 }} }}"
    study = chosen_laws(f"{LAW}={{ type = 'constant', factor = 0.5 }}", f"tune.choices.law.memory={forgetting}")
    found = explore(BlackBox(study, method, batch=8), tmp_path, trials=48, quiet=True)
    assert found.best.chosen == {"law": "memory"}
    # A parameter is asked for where it exists only.
    for trial in found.trials:
        expected = {PRIOR, FORGETTING} if trial.chosen["law"] == "memory" else {PRIOR}
        assert trial.values.keys() == expected
    laws = [trial.chosen["law"] for trial in found.trials]
    assert laws[:2] == ["memory", "rigid"]
    if method == "tpe":
        assert laws[-16:].count("memory") > 12
    rows = pq.read_table(tmp_path / "results.parquet").to_pylist()
    assert [row["choices.law"] for row in rows] == laws
    assert [math.isnan(row[FORGETTING]) for row in rows] == [law == "rigid" for law in laws]
    best = load_study(tmp_path / "best.toml")
    assert resolved(best)["estimator"]["fit"]["law"]["type"] == "forgetting"
    assert best.provenance["choices"] == {"law": "memory"}
    # The best is a plain study, which a gradient can refine.
    assert not best.tune.choices
    assert plan_search(best, "gradient", "bfgs", "best.toml").own == found.tuned.values


@pytest.mark.slow(
    twin="tests/tuning/test_golden_runs.py::test_an_unfinished_run_goes_on_to_the_results_that_it_would_have_had"
)
def test_each_structure_is_scored_as_the_study_that_it_is_with_one_trace(tmp_path):
    study = chosen_laws()
    box = BlackBox(study, "tpe", batch=4)
    found = explore(box, tmp_path, trials=12, quiet=True)
    for options, fixed in (("memory", {}), ("rigid", {"type": "constant", "factor": 0.9})):
        search = box.search_of({"law": options})
        assert search.program._cache_size() == 1
        members = [trial for trial in found.trials if trial.chosen["law"] == options]
        assert members
        last = members[-1]
        tables = resolved(search.study)["estimator"]["fit"]["law"]
        assert tables == (fixed or {"type": "forgetting", "forgetting": 0.95})
        alone = search.screen(np.array([[last.values[path] for path in search.paths]]))
        np.testing.assert_allclose(last.objective, alone[0], rtol=1e-9)


@pytest.mark.usefixtures("bowl", "unjudged")
def test_the_front_is_not_dominated_and_the_most_accurate_of_it_is_the_best(tmp_path):
    found = explore(BlackBox(tiny_tuning(), "pareto", batch=8), tmp_path, trials=64, quiet=True)

    def beats(a: Trial, b: Trial) -> bool:
        first, second = (a.objective, a.convergence_time), (b.objective, b.convergence_time)
        return first != second and first[0] <= second[0] and first[1] <= second[1]

    scored = [trial for trial in found.trials if trial.is_scored]
    expected = {t.number for t in scored if not any(beats(other, t) for other in scored)}
    assert {trial.number for trial in found.front} == expected
    # Convergence is the faster the smaller the prior, accuracy is best at 2: they conflict.
    assert len(found.front) > 3
    assert found.best.objective == min(trial.objective for trial in scored)
    # An endless convergence time counts as the recording's duration.
    assert max(trial.convergence_time for trial in scored) <= 0.2


def test_of_equal_trials_the_front_has_one():
    trials = [Trial(i, {}, {}, objective, time, 0.0) for i, (objective, time) in enumerate(
        [(1.0, 2.0), (1.0, 2.0), (2.0, 1.0), (2.0, 3.0), (math.nan, 0.0), (3.0, 1.0)]
    )]  # fmt: skip
    assert [trial.number for trial in find_front(trials)] == [0, 2]


@pytest.mark.failure
@pytest.mark.parametrize(
    ("choices", "expected"),
    [
        (
            "{ basis = { rich = { 'estimator.basis.deflection_term' = 6 }, own = {} } }",
            "tune.choices.basis.rich.'estimator.basis.deflection_term': unknown key",
        ),
        (
            "{ basis = { rich = { 'estimator.basis.deflection_terms' = 0 }, own = {} }, b = { x = {}, y = {} } }",
            "tune.choices.basis.rich.'estimator.basis.deflection_terms': got 0; input should be greater",
        ),
        (
            "{ law = { a = { 'estimator.fit.law' = { type = 'luck' } } } }",
            "tune.choices.law.a.'estimator.fit.law.type': got 'luck'; allowed",
        ),
        (
            "{ law = { a = { 'estimator.fit.prior_scale.x' = 1 } } }",
            "tune.choices.law.a.'estimator.fit.prior_scale.x': leads through a value",
        ),
        ("{ s = { a = { 'scorer.warm_up' = 1.0 } } }", "tune.choices.s.a.'scorer.warm_up': is not a path"),
        ("{ s = {} }", "tune.choices.s: has no option"),
        (
            f"{{ a = {{ x = {{ '{PRIOR}' = 1.0 }} }}, b = {{ y = {{ '{PRIOR}' = 2.0 }} }} }}",
            f"tune.choices.b.y.'{PRIOR}': is set by tune.choices.a too",
        ),
        (
            "{ law = { a = { 'estimator.fit.law' = { type = 'unit' } } } }",
            f"tune.parameters.'{FORGETTING}': leads to no number",
        ),
    ],
)
def test_a_mistake_in_choices_is_named_once_with_its_path(choices, expected):
    with pytest.raises(InputError) as caught:
        tiny_tuning(f"tune.choices={choices}")
    assert str(caught.value).count(expected) == 1
    assert len(caught.value.mistakes) == 1


@pytest.mark.failure
def test_what_a_combination_lacks_is_named_with_the_combination():
    with pytest.raises(InputError, match=r"tune\.choices \(torque = other\): sensing\.elastic_torque: is missing"):
        tiny_tuning(
            "estimator.torque={type='residual', observer_gain=100.0, motor_inertia=1e-5, motor_damping=1e-3}",
            "tune.choices.torque={ own = {}, other = { 'estimator.torque' = { type = 'sensor' } } }",
            "sensing={ link_position = {}, motor_position = {}, setpoint_position = {}, motor_torque = {} }",
        )


@pytest.mark.failure
@pytest.mark.parametrize("method", ["gradient", "grid", "hybrid"])
def test_methods_that_vary_numbers_only_refuse_choices(method):
    with pytest.raises(InputError, match=rf"s\.toml: tune\.choices: .*--method {method}.*\n.*--method tpe"):
        plan_search(chosen_laws(), method, "bfgs", "s.toml")


@pytest.mark.failure
def test_a_black_box_refuses_what_it_cannot_tune():
    with pytest.raises(InputError, match=r"tune\.choices: .*cmaes.*\n.*--method tpe"):
        plan_blackbox(chosen_laws(), "cmaes", 8, "s.toml")
    with pytest.raises(InputError, match=r"tune\.parameters: names no number to tune"):
        plan_blackbox(tiny_tuning("tune={}"), "tpe", 8, "s.toml")
    single = tiny_tuning(f"tune.parameters={{ '{PRIOR}' = {{ low = 0.1, high = 1.0 }} }}")
    with pytest.raises(InputError, match=r"CMA-ES needs two or more parameters"):
        plan_blackbox(single, "cmaes", 8, "s.toml")


@pytest.mark.cli
@pytest.mark.usefixtures("unjudged")
def test_a_front_is_reported_drawn_and_interrupted_from_the_shell(vsajax, monkeypatch, tmp_path):
    from tuning.study.base import to_toml

    path = tmp_path / "study.toml"
    path.write_text(to_toml(resolved(chosen_laws())))
    words = ("tune", path, "-o", tmp_path / "run", "--method", "pareto", "--trials", "8", "--batch", "4")

    def interrupt(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(blackbox, "run_batch", interrupt)
        assert vsajax(*words).code == 3
    said = vsajax(*words, "--resume", "--json")
    assert said.code == 0, said.err
    result = json.loads(said.out)
    assert (result["method"], result["trials"], result["failed"], result["evaluations"]) == ("pareto", 8, 0, 8)
    assert result["front"][0]["choices.law"] == result["choices"]["law"]
    assert (tmp_path / "run" / "figures" / "pareto.png").is_file()
    text = vsajax(*words, "--resume")
    assert "8 trials, 0 of them without a finite score" in text.out
    assert "8 evaluations in" in text.out
    assert "holds this run already" in vsajax(*words).err
    assert "holds another run" in vsajax(*words[:-1], "2", "--resume").err
    store = RunStore(tmp_path / "run", read_manifest(tmp_path / "run" / "manifest.json"))
    assert len(read_trials(blackbox.open_journal(store, 2))) == 8
