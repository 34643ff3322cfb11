"""A contest: every structure tuned by as many trials, then compared on what no search saw."""

from __future__ import annotations

import json

import pytest

from tests.tuning.builders import FORGETTING, PRIOR, tiny_tuning
from tuning.files.errors import InputError
from tuning.files.shipped import CONFIGS
from tuning.search.contest import contest
from tuning.study.base import study_hash
from tuning.study.loading import load_study
from tuning.study.paths import numeric_paths
from tuning.study.structures import structures

DAMPING = CONFIGS / "contests" / "damping.toml"
LAW = "estimator.fit.law"
BOUNDS = (
    f"'{PRIOR}' = {{ low = 1e-3, high = 10.0, only = ['memory'] }}, '{FORGETTING}' = {{ low = 0.5, high = 0.999 }}"
)
CHOICES = f"tune.choices.law={{ memory = {{}}, rigid = {{ '{LAW}' = {{ type = 'constant', factor = 0.9 }} }} }}"


def chosen_laws():
    """Return a study of two laws, one of which has nothing to tune."""
    return tiny_tuning(f"tune.parameters={{ {BOUNDS} }}", CHOICES)


@pytest.mark.contract
def test_the_shipped_contest_tunes_of_every_rule_what_it_has():
    tuned = {
        chosen["rule"]: set(study.tune.parameters) for chosen, study in structures(load_study(DAMPING), "here")
    }
    assert (tuned["soft"], tuned["stiff"]) == (set(), set())
    assert tuned["law"] == {"observer.cutoff"}
    assert tuned["conic"] == {"observer.cutoff", "controller.rule.lead", "controller.rule.slope"}
    assert "controller.stiffness" in tuned["pid"]
    assert {"controller.motor.derivative", "controller.stiffness.conic.lead"} < tuned["combined"]
    # No parameter is for nothing, and a structure's own study is whole in itself.
    assert set().union(*tuned.values()) == set(load_study(DAMPING).tune.parameters)
    for _, study in structures(load_study(DAMPING), "here"):
        assert set(structures(study, "here")[0][1].tune.parameters) == set(study.tune.parameters)


@pytest.mark.contract
def test_a_parameter_can_be_one_of_some_options_alone():
    found = {chosen["law"]: set(study.tune.parameters) for chosen, study in structures(chosen_laws(), "here")}
    assert found == {"memory": {PRIOR, FORGETTING}, "rigid": set()}
    plain = tiny_tuning()
    assert "only" not in json.dumps(plain.model_dump(exclude_none=True))
    assert study_hash(plain) == study_hash(tiny_tuning())


@pytest.mark.failure
def test_what_is_no_contest_says_what_to_do(tmp_path):
    with pytest.raises(InputError, match="fewer than two contestants"):
        contest(tiny_tuning(), tmp_path / "run")
    assert not (tmp_path / "run").exists()
    with pytest.raises(InputError, match="which is no option of tune"):
        tiny_tuning(f"tune.parameters={{ {BOUNDS} }}")


@pytest.mark.slow(
    twin="tests/tuning/test_golden_runs.py::test_an_unfinished_run_goes_on_to_the_results_that_it_would_have_had"
)
@pytest.mark.cli
def test_contestants_are_tuned_alike_and_paired_with_the_best_on_training(tmp_path):
    study = chosen_laws()
    entrants = contest(study, tmp_path / "run", trials=8, batch=8, quiet=True)
    assert [entrant.train for entrant in entrants] == sorted(entrant.train for entrant in entrants)
    first, second = entrants
    assert first.judged is not None
    assert second.judged is not None
    assert first.judged.difference == 0.0
    assert second.judged.difference == pytest.approx(second.judged.judgement.value - first.judged.judgement.value)
    for entrant in entrants:
        tuned = load_study(entrant.path)
        assert {path: numeric_paths(tuned)[path] for path in entrant.values} == pytest.approx(entrant.values)
    again = contest(study, tmp_path / "run", trials=8, batch=8, quiet=True, resume=True)
    assert [(e.name, e.train) for e in again] == [(e.name, e.train) for e in entrants]
