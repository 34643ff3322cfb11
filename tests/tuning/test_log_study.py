"""A study of a log is a kind like the others: every method runs over its two parts, and what it lacks is told."""

from __future__ import annotations

import json
import os
import re
import shutil
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.tuning.logs.motor_log import MOTOR_DAMPING, MOTOR_INERTIA, write_study
from tuning.files.errors import InputError
from tuning.problem.interface import problem_of
from tuning.runs.manifest import read_manifest
from tuning.runs.workers import planner_of, spec_of
from tuning.search.refine import Search
from tuning.study.base import Config, resolved, study_hash, to_toml
from tuning.study.loading import load_config, load_study
from vsajax.rollout import sensitivity

GAIN = "estimator.torque.observer_gain"
CHOICES = """
[tune.choices.offset.free]
"estimator.basis.deflection_offset" = true
[tune.choices.offset.none]
"estimator.basis.deflection_offset" = false
"""
BEFORE = {
    "agreement": {
        (0.0001000000000000001, 1.9999999999999998e-05): 90.50985448581079,
        (0.0001121367443011191, 0.0007804779817582202): 94.38093121070841,
        (0.004069661590590964, 2.101717452014121e-06): 3.1117661509827568,
    },
    "no_load": {
        (0.0001000000000000001, 1.9999999999999998e-05): 77.69341225646768,
        (0.0001121367443011191, 0.0007804779817582202): 156.41486595542293,
        (0.004069661590590964, 2.101717452014121e-06): 5.191515565178872,
    },
}
"""Objectives by damping and inertia, of the search that logs had of their own [%]."""
KEYS = {
    *("run", "best", "picture", "method", "values", "evaluations", "seconds", "train", "held_out", "messages"),
    *("before_on_held_out", "objective", "before", "whole", "floor", "share_within", "notes"),
}
GOLDEN = Path(__file__).parents[1] / "golden" / "log_search"
"""The run folder of a search that logs had of their own: no manifest, no chunks."""
AGREEMENT = {"correlation", "unlagged", "stiffness", "rms", "samples"}


@pytest.fixture(scope="module")
def study_file(tmp_path_factory):
    """A log and the study of it."""
    return write_study(tmp_path_factory.mktemp("log"))


@pytest.fixture(scope="module")
def problem(study_file):
    """The study made computable."""
    return problem_of(load_study(study_file), (MOTOR_DAMPING, MOTOR_INERTIA))


def part_of(problem, stream):
    return jax.tree.map(lambda x: x[0], problem.scenarios(stream, 1))


def tuned(vsajax, study, run, *options):
    """Return what `tune` says for machines."""
    ended = vsajax("tune", study, "-o", run, "--json", *options)
    assert (ended.code, ended.err) == (0, "")
    return json.loads(ended.out)


@pytest.mark.equivalence
@pytest.mark.parametrize("objective", BEFORE)
def test_the_objective_is_what_it_was_when_logs_had_a_search_of_their_own(study_file, objective):
    search = Search(load_study(study_file, [f"tune.objective={objective}"]), "grid")
    assert search.paths == (MOTOR_DAMPING, MOTOR_INERTIA)
    np.testing.assert_allclose(
        search.screen(np.array(list(BEFORE[objective]))), list(BEFORE[objective].values()), rtol=1e-12
    )


@pytest.mark.analytic
def test_both_parts_are_scored_and_the_rest_of_one_is_the_other(problem):
    outcomes = {
        stream: jax.jit(problem.outcome)({}, part_of(problem, stream), problem.given).scores
        for stream in ("train", "held_out")
    }
    train, held_out = outcomes.values()
    assert float(train.agreement) == pytest.approx(float(held_out.rest), rel=1e-12)
    assert float(held_out.agreement) == pytest.approx(float(train.rest), rel=1e-12)
    assert abs(float(train.agreement) - float(held_out.agreement)) > 1.0


@pytest.mark.gradient
@pytest.mark.parametrize("objective", BEFORE)
def test_the_normal_equations_hold_the_objective_and_its_slope(study_file, objective):
    study = load_study(study_file, [f"tune.objective={objective}"])
    problem = problem_of(study, (MOTOR_DAMPING, MOTOR_INERTIA))
    part = part_of(problem, "train")

    def values_at(z):
        return {MOTOR_DAMPING: 1e-3 * z[0], MOTOR_INERTIA: 1e-5 * z[1]}

    def objective_at(z, observed=None):
        return sensitivity.sum_of_squares(problem.residuals(values_at(z), part, problem.given, observed))

    z, step = jnp.array([2.0, 5.0]), 1e-5
    observed = problem.observe({}, part, problem.given)
    square = jax.jit(
        lambda z: sensitivity.normal_equations(
            lambda z: problem.residuals(values_at(z), part, problem.given, observed), z
        )
    )(z)
    compiled = jax.jit(objective_at)
    slope = [(compiled(z + step * e) - compiled(z - step * e)) / (2 * step) for e in jnp.eye(2)]
    np.testing.assert_allclose(square[-1, -1], compiled(z), rtol=1e-12)
    np.testing.assert_allclose(2.0 * square[-1, :-1], slope, rtol=1e-6)


@pytest.mark.cli
@pytest.mark.parametrize(
    ("options", "most"),
    [
        pytest.param(("--algorithm", "bfgs", "--starts", "1"), 1.0, marks=pytest.mark.slow),
        (("--method", "grid"), 90.0),
        pytest.param(("--method", "hybrid", "--starts", "1"), 1e-3, marks=pytest.mark.slow),
        (("--method", "tpe", "--trials", "24", "--batch", "8"), 60.0),
        (("--method", "cmaes", "--trials", "24", "--batch", "8"), 60.0),
    ],
    ids=lambda given: " ".join(given) if isinstance(given, tuple) else None,
)
def test_every_method_searches_a_log(vsajax, study_file, tmp_path, options, most):
    run = tmp_path / "run"
    found = tuned(vsajax, study_file, run, *options)
    assert found.keys() >= KEYS
    assert found["objective"] < most < found["before"]
    for part in ("train", "held_out"):
        assert found[part].keys() >= AGREEMENT
        # One scenario has no interval.
        assert (found[part]["scenarios"], found[part]["low"], found[part]["high"]) == (1, None, None)
        assert "convergence_time" not in found[part]
    assert found["train"]["value"] == pytest.approx(found["objective"], rel=1e-6)
    best = load_config(run / "best.toml")
    assert best.provenance["held_out"]["samples"] == found["held_out"]["samples"] == 1999
    assert "low" not in best.provenance["held_out"]
    # What `estimate -c` takes: the estimator alone.
    assert type(best) is Config
    assert best.provenance.keys() >= {
        *("command", "method", "objective", "recording", "study_hash", "seed", "versions", "tuned"),
        *("train", "held_out", "noise_floor", "held_out_within_floor"),
    }
    assert pq.read_table(run / "results.parquet")["objective"].to_numpy().min() == found["objective"]
    assert (run / "figures" / "tuning.png").stat().st_size > 0


@pytest.mark.cli
def test_a_run_that_was_killed_goes_on_and_a_log_that_changed_is_refused(vsajax, tmp_path):
    study, run = write_study(tmp_path), tmp_path / "run"
    tuned(vsajax, study, run, "--starts", "1")
    first = (run / "best.toml").read_bytes()
    for name in ("best.toml", "results.parquet", "chunks/start-000.parquet"):
        (run / name).unlink()
    kept = (run / "chunks" / "screen.parquet").stat().st_mtime_ns
    assert "holds an unfinished run" in vsajax("report", run).err
    tuned(vsajax, study, run, "--starts", "1", "--resume")
    assert (run / "best.toml").read_bytes() == first
    assert (run / "chunks" / "screen.parquet").stat().st_mtime_ns == kept

    log = tmp_path / "log.parquet"
    table = pq.read_table(log)
    pq.write_table(table.slice(0, table.num_rows - 1), log)
    for words in (("tune", study, "-o", run, "--starts", "1", "--resume"), ("report", run)):
        ended = vsajax(*words)
        assert ended.code == 2
        assert f"{log}: has changed since the run" in ended.err


@pytest.mark.cli
def test_a_report_shows_the_parts_the_numbers_and_no_interval(vsajax, study_file, tmp_path):
    run = tmp_path / "run"
    found = tuned(vsajax, study_file, run, "--method", "tpe", "--trials", "16", "--batch", "8")
    ended = vsajax("report", run, "--json")
    assert (ended.code, ended.err) == (0, "")
    said = json.loads(ended.out)
    value = f"{found['held_out']['value']:.4g}"
    assert said["headline"].startswith("Tuning takes unexplained torque 98.56 % to ")
    assert f"unexplained torque {value} % on what was held out: difference" in said["headline"]
    assert said["pictures"] >= 6
    page = Path(said["report"]).read_text(encoding="utf-8")
    for words in ("Agreement of torque and deflection", "whole log", "Torque over deflection", "Torque over time"):
        assert words in page
    assert re.search(r">\s*nan\s*<", page) is None
    assert "motor_damping" in page


@pytest.mark.cli
@pytest.mark.failure
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("tune", "--method", "pareto"), ["kind 'log' has no convergence time", "tpe"]),
        (("montecarlo",), ["kind 'log' has no scenarios to draw (a recording is one", "fix: "]),
        (("simulate",), ["kind 'log' has no ", "fix: "]),
        (("export", "--to", "json"), ["is a study of a log"]),
        (("sweep", "--grid", f"{GAIN}=5,10", "--scenarios", "3"), ["scenarios", "3"]),
        (("sweep", "--grid", f"{GAIN}=-5,10"), ["reaches -5, which is not allowed there"]),
        (("sweep",), ["sweep.grid", "has no axis"]),
        (("contest",), ["tune.choices", "fewer than two contestants"]),
        (("tune", "--set", "population={'estimator.torque.motor_inertia'={std=1e-6}}"), ["population", "unknown"]),
    ],
    ids=lambda given: given[0] if isinstance(given, tuple) else None,
)
def test_what_a_log_has_not_is_refused_and_nothing_is_written(vsajax, study_file, tmp_path, words, said):
    command, *options = words
    ended = vsajax(command, study_file, "-o", tmp_path / "run", *options)
    assert (ended.code, ended.out) == (2, "")
    for part in said:
        assert part in ended.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.cli
@pytest.mark.failure
def test_a_finished_run_of_before_is_reported_on_and_never_written_over(vsajax, study_file, tmp_path):
    run = shutil.copytree(GOLDEN, tmp_path / "run")
    before = (run / "best.toml").read_bytes()
    for options in ((), ("--resume",)):
        ended = vsajax("tune", study_file, "-o", run, *options)
        assert ended.code == 2
        assert "is not empty and holds no run" in ended.err
    assert (run / "best.toml").read_bytes() == before
    ended = vsajax("report", run)
    assert (ended.code, ended.err) == (0, "")
    assert "of 11 points" in ended.out


@pytest.fixture(scope="module")
def swept(study_file, tmp_path_factory):
    """The folder of a sweep over the gain."""
    from tuning.cli.main import run as run_command

    folder = tmp_path_factory.mktemp("sweep") / "run"
    assert run_command(["sweep", str(study_file), "-o", str(folder), "--grid", f"{GAIN}=5,10,20", "--quiet"]) == 0
    return folder


@pytest.mark.cli
def test_a_sweep_ranks_by_the_training_part_with_the_held_out_one_beside(vsajax, study_file, swept, problem):
    table = pq.read_table(swept / "results.parquet").to_pylist()
    assert [row[GAIN] for row in table] == [5.0, 10.0, 20.0]
    for row in table:
        values = {GAIN: jnp.array(row[GAIN])}
        for stream, name in (("train", "agreement"), ("held_out", "rest")):
            score = problem.outcome(values, part_of(problem, stream), problem.given).scores.agreement
            assert row[name] == pytest.approx(float(score), rel=1e-9)
    ended = vsajax("sweep", study_file, "-o", swept, "--grid", f"{GAIN}=5,10,20", "--resume", "--json")
    best = json.loads(ended.out)["best"]
    assert [row["mean"] for row in best] == sorted(row["agreement"] for row in table)
    assert {row["rest"] for row in best} == {row["rest"] for row in table}
    winner = load_study(swept / "best.toml")
    assert winner.estimator.torque.observer_gain == best[0][GAIN]
    assert vsajax("report", swept).code == 0


@pytest.mark.equivalence
@pytest.mark.failure
def test_a_worker_in_another_folder_computes_the_same_and_refuses_another_log(tmp_path, monkeypatch, vsajax):
    write_study(tmp_path)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    sweep = ("sweep", "study.toml", "-o", "run", "--set", "recording.file=log.parquet", "--grid", f"{GAIN}=5,10")
    assert vsajax(*sweep).code == 0
    spec = spec_of(read_manifest(tmp_path / "run" / "manifest.json"))
    monkeypatch.chdir(tmp_path / "elsewhere")
    planner = planner_of(spec)
    chunk = planner.run_chunk("000000")
    np.testing.assert_array_equal(
        chunk["agreement"], pq.read_table(tmp_path / "run" / "results.parquet")["agreement"]
    )
    planner_of.cache_clear()
    os.truncate(tmp_path / "log.parquet", 1000)
    with pytest.raises(InputError, match="has changed since the run"):
        planner_of(spec)


@pytest.mark.cli
def test_estimators_are_compared_on_the_held_out_part(vsajax, study_file, tmp_path, problem):
    own, other = tmp_path / "own.toml", tmp_path / "other.toml"
    for path, gain in ((own, 15.0), (other, 5.0)):
        path.write_text(to_toml(resolved(load_study(study_file, [f"{GAIN}={gain}"]).deployed())))
    ended = vsajax("compare", own, other, "-s", study_file, "-o", tmp_path / "run", "--json")
    assert (ended.code, ended.err) == (0, "")
    first, second = json.loads(ended.out)["configs"]
    part = part_of(problem, "held_out")
    for row, values in ((first, {}), (second, {GAIN: jnp.array(5.0)})):
        score = float(problem.outcome(values, part, problem.given).scores.agreement)
        assert row["value"] == pytest.approx(score, rel=1e-9)
        assert (row["low"], row["high"]) == (None, None)
    assert second["difference"] == pytest.approx(second["value"] - first["value"], rel=1e-9)
    assert (second["difference_low"], second["verdict"]) == (None, "no interval")
    assert vsajax("report", tmp_path / "run").code == 0
    ended = vsajax("compare", own, other, "-s", study_file, "-o", tmp_path / "more", "--scenarios", "4")
    assert ended.code == 2
    assert "scenarios" in ended.err


@pytest.mark.cli
def test_choices_are_made_by_trials_and_held_against_each_other(vsajax, tmp_path):
    study = write_study(tmp_path, CHOICES)
    run = tmp_path / "run"
    ended = vsajax("contest", study, "-o", run, "--method", "tpe", "--trials", "8", "--batch", "8", "--json")
    assert (ended.code, ended.err) == (0, "")
    rows = json.loads(ended.out)["configs"]
    assert {row["config"] for row in rows} == {"free", "none"}
    assert all(load_config(Path(row["best"])).provenance["recording"]["train_until"] == 3.0 for row in rows)
    ended = vsajax("report", run)
    assert (ended.code, ended.err) == (0, "")
    assert "Best of 2: " in ended.out


@pytest.mark.structure
def test_what_a_log_study_has_gained_is_not_in_its_hash_until_it_is_used(study_file):
    study = load_study(study_file)
    same = load_study(study_file, ["sweep={grid={}}", "tune.choices={}"])
    other = load_study(study_file, [f"sweep.grid={{'{GAIN}'=[1.0,2.0]}}"])
    assert study_hash(study) == study_hash(same)
    assert study_hash(other) != study_hash(study)
