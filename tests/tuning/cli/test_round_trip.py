"""From `init` to a tuned and exported configuration, as a user goes."""

from __future__ import annotations

import json
import tomllib

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.tuning.builders import FORGETTING, PRIOR, SERIAL, SMALL, tiny_tuning
from tuning.files.shipped import CONFIGS
from tuning.files.whole import write_table
from tuning.kinds.arm.study import load_arm_study
from tuning.logs.columns import read_log_file
from tuning.runs.forecast import Forecast
from tuning.scoring.intervals import judge
from tuning.scoring.sweep import GridSweep
from tuning.search.refine import Search
from tuning.study.base import Tune, resolved, study_hash, to_toml
from tuning.study.loading import load_config, load_study
from vsajax import Scores

KINDS = sorted(path.stem for path in (CONFIGS / "studies").glob("*.toml"))
BRIEF = ("--duration", "0.1")
SHORT = [word for setting in SMALL for word in ("--set", setting)]
MEASURED = ["link_position", "motor_position", "setpoint_position", "motor_torque", "elastic_torque"]
SCORES = {"mse", "msrep", "msrep_settled", "convergence_time", "coverage", "known_time", "diverged"}


def answer(ended) -> dict:
    """Return the one JSON object that a command printed."""
    assert (ended.code, ended.err) == (0, "")
    return json.loads(ended.out)


@pytest.mark.cli
@pytest.mark.parametrize("kind", KINDS)
def test_a_new_study_is_valid_and_prints_itself_in_full(kind, vsajax, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ended = vsajax("init", kind)
    assert (ended.code, ended.err) == (0, "")
    schema = f"{tomllib.loads((tmp_path / f'{kind}.toml').read_text())['kind']}.schema.json"
    said = f"wrote {kind}.toml, and {schema}, by which editors complete and check it"
    assert ended.out == f"{said}\nNext: vsajax check {kind}.toml\n"
    assert (tmp_path / schema).is_file()
    assert "#" in (tmp_path / f"{kind}.toml").read_text()
    study = (load_arm_study if kind == "arm" else load_study)(tmp_path / f"{kind}.toml")

    printed = vsajax("check", f"{kind}.toml")
    assert printed.code == 0
    assert tomllib.loads(printed.out) == resolved(study)
    assert f"# {kind}.toml: valid study, hash {study_hash(study)}" in printed.out
    # What is printed is a study of its own.
    (tmp_path / "full.toml").write_text(printed.out)
    result = answer(vsajax("check", "full.toml", "--json"))
    assert (result["ok"], result["what"], result["hash"]) == (True, "study", study_hash(study))
    assert result["study"] == json.loads(json.dumps(resolved(study)))


@pytest.mark.cli
def test_a_new_study_goes_where_it_is_told(vsajax, tmp_path):
    target = tmp_path / "deep" / "mine.toml"
    schema = str(target.parent / "sea.schema.json")
    assert answer(vsajax("init", "sea", target, "--json")) == {"study": str(target), "schema": schema}
    assert vsajax("init", "sea", tmp_path / "other.toml", "--quiet") == (0, "", "")
    assert load_study(target) == load_study(tmp_path / "other.toml")


@pytest.mark.cli
@pytest.mark.slow(twin="tests/tuning/cli/test_following.py::test_machines_and_the_quiet_are_told_no_next_command")
def test_who_wants_quiet_is_told_nothing(vsajax, tmp_path):
    for words in (
        ("check", SERIAL),
        ("export", SERIAL, "--to", "json", "-o", tmp_path / "deploy", *BRIEF),
        ("doctor",),
    ):
        assert vsajax(*words, "--quiet") == (0, "", "")
    assert (tmp_path / "deploy" / "estimator.json").exists()


@pytest.mark.cli
def test_an_estimate_that_diverges_is_an_answer_and_says_from_when(vsajax, tmp_path):
    study, log = CONFIGS / "studies" / "serial.toml", tmp_path / "log.parquet"
    assert vsajax("simulate", study, "-o", log, *SHORT, "-q").code == 0
    words = ("estimate", log, "-c", study, "-o", tmp_path / "e.csv", *SHORT)
    # A gain at which the observer's torque overflows.
    ended = vsajax(*words, "--set", "estimator.torque.observer_gain=1e308")
    assert (ended.code, ended.err) == (0, "")
    assert "the estimate DIVERGED: it is not finite from t = 0." in ended.out
    assert answer(vsajax(*words, "--set", "estimator.torque.observer_gain=1e308", "--json"))["diverged"] is True


@pytest.mark.cli
def test_a_prior_beyond_all_sense_is_not_known_rather_than_no_number(vsajax, tmp_path):
    time = np.linspace(0.0, 1.0, 50)
    columns = {"time": time, "deflection": np.sin(9 * time), "elastic_torque": 40 * np.sin(9 * time)}
    write_table(tmp_path / "log.csv", columns)
    config = CONFIGS / "tuned" / "sea_sensor.toml"
    words = ("estimate", tmp_path / "log.csv", "-c", config, "-o", tmp_path / "e.csv", "--json")
    assert answer(vsajax(*words))["final_stiffness"] == pytest.approx(40.0, rel=1e-6)
    absurd = answer(vsajax(*words, "--set", "estimator.fit.prior_scale=1e308"))
    assert not absurd["diverged"]
    assert absurd["known_from"] is None


@pytest.mark.cli
def test_a_configuration_without_a_joint_is_checked_as_one(vsajax):
    path = CONFIGS / "tuned" / "sea_sensor.toml"
    result = answer(vsajax("check", path, "--json"))
    assert (result["what"], result["hash"]) == ("estimator configuration", study_hash(load_config(path)))


@pytest.mark.cli
def test_a_recording_is_simulated_estimated_and_scored_in_either_form(vsajax, tmp_path):
    study = tmp_path / "study.toml"
    assert vsajax("init", "serial", study).code == 0
    tables = []
    for suffix in ("parquet", "csv"):
        recording, output = tmp_path / f"recording.{suffix}", tmp_path / f"estimate_{suffix}.parquet"
        made = answer(vsajax("simulate", study, "-o", recording, *SHORT, "--json"))
        assert made == {
            "recording": str(recording),
            "picture": str(recording.with_suffix(".png")),
            "samples": 201,
            "substeps": 3,
            "robot": None,
        }
        log = read_log_file(recording)
        assert sorted(log.names) == sorted(["time", *MEASURED, "true_stiffness", "true_elastic_torque"])

        result = answer(vsajax("estimate", recording, "-c", study, "-o", output, *SHORT, "--json"))
        assert (result["estimate"], result["picture"]) == (str(output), str(output.with_suffix(".png")))
        assert result["scores"].keys() >= SCORES
        table = pq.read_table(output)
        assert {"time", "stiffness", "stiffness_std", "elastic_torque", "known"} <= set(table.column_names)
        assert str(table.schema.field("known").type) == "bool"
        stiffness, actual = table["stiffness"].to_numpy(), log.numbers("true_stiffness", np.arange(201))
        # MSREP as printed in (36): a sum over all samples, divided by one less, in percent.
        msrep = 100.0 * np.sum(((actual - stiffness) / actual) ** 2) / 200
        assert result["scores"]["msrep"] == pytest.approx(msrep, rel=1e-12)
        assert result["final_stiffness"] == stiffness[-1]
        for path in (recording, output):
            assert path.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
        tables.append(table)
    assert tables[0].equals(tables[1])

    words = ("estimate", recording, "-c", study, "-o", tmp_path / "e.csv", *SHORT)
    ended = vsajax(*words)
    assert (ended.code, ended.err) == (0, "")
    for said in ("known from", "final stiffness", "against the truth: MSREP", f"wrote {tmp_path / 'e.csv'}"):
        assert said in ended.out
    said = vsajax(*words, "--set", "estimator.gate.min_deflection_range=1.0").out
    assert "the stiffness is NOT KNOWN: the deflection moves by 47.9 mrad in all, and estimator.gate" in said
    assert vsajax(*words, "--quiet") == (0, "", "")


@pytest.mark.cli
def test_every_scenario_and_seed_is_a_draw_of_its_own(vsajax, tmp_path):
    draws = {"a": (), "b": ("--scenario", "1"), "c": ("--seed", "1"), "d": ("--scenario", "0", "--seed", "0")}
    for name, words in draws.items():
        ended = vsajax("simulate", SERIAL, "-o", tmp_path / f"{name}.csv", *SHORT, *words)
        assert (ended.code, ended.err) == (0, "")
        assert f"wrote {tmp_path / name}.csv (201 samples, 3 integration steps each)" in ended.out
    logs = {name: read_log_file(tmp_path / f"{name}.csv") for name in draws}
    torque, stiffness = (
        {name: log.numbers(column, np.arange(201))[7] for name, log in logs.items()}
        for column in ("motor_torque", "true_stiffness")
    )
    assert len({torque[name] for name in "abc"}) == 3
    assert torque["a"] == torque["d"]
    assert len(set(stiffness.values())) == 1


@pytest.fixture
def tiny(tmp_path):
    """A study with one coefficient and two numbers to tune, as a file."""
    path = tmp_path / "tiny.toml"
    path.write_text(to_toml(resolved(tiny_tuning())))
    return path


@pytest.mark.cli
def test_a_sweep_is_forecast_run_and_reported(vsajax, tiny, tmp_path, monkeypatch):
    run = tmp_path / "sweep"
    grid = ("--grid", f"{PRIOR}=log(0.1,10,3)", "--grid", f"{FORGETTING}=0.9,1")
    words = ("sweep", tiny, "-o", run, *grid, "--scenarios", "2")
    forecast = answer(vsajax(*words, "--dry-run", "--json"))
    assert not run.exists()
    assert (forecast["configurations"], forecast["scenarios"], forecast["chunks"]) == (6, 2, 1)
    monkeypatch.setattr(GridSweep, "forecast", lambda _: Forecast(1, 2**30, 1.5, 2.5))
    said = vsajax(*words, "--dry-run").out
    for expected in ("6 configurations × 2 scenarios, 1 chunks", "1.00 GiB", "compile 1.5 s", "run 2.5 s"):
        assert expected in said

    result = answer(vsajax(*words, "--json"))
    assert len(result["best"]) == 6
    means = [row["mean"] for row in result["best"]]
    assert means == sorted(means)
    assert pq.read_table(result["results"]).num_rows == 12
    assert {path.name for path in run.iterdir()} == {
        "best.toml",
        "manifest.json",
        "chunks",
        "results.parquet",
        "figures",
    }
    assert answer(vsajax(*words, "--resume", "--json"))["best"] == result["best"]
    assert vsajax(*words, "--resume", "--quiet") == (0, "", "")
    assert "go on with --resume" in vsajax(*words).err


@pytest.mark.slow(
    twin=(
        "tests/tuning/test_golden_runs.py::test_a_finished_run_stays_as_it_is_to_the_bit",
        "tests/tuning/test_golden_runs.py::test_the_best_of_a_run_is_checked_simulated_and_exported",
    )
)
@pytest.mark.cli
def test_a_study_is_tuned_and_the_best_is_exported(vsajax, tiny, tmp_path, monkeypatch):
    words = ("tune", tiny, "-o", tmp_path / "tune", "--starts", "1", "--budget", "2")
    result = answer(vsajax(*words, "--json"))
    assert len(result["starts"]) == 1
    assert result["held_out"]["mean"] < result["before_on_held_out"]["mean"]
    best = load_study(tmp_path / "tune" / "best.toml")
    assert best.provenance["held_out"]["mean"] == result["held_out"]["mean"]
    kept = judge({name: np.full(5, 2.0) for name in Scores._fields} | {"diverged": np.zeros(5)}, Tune(), seed=0)
    monkeypatch.setattr(Search, "judge", lambda *_: kept)
    again = vsajax(*words, "--resume")
    assert again.code == 0
    for line in ("before, 5 held out:", "tuned, 5 training:", "tuned, 5 held out:"):
        assert line in again.out

    assert vsajax(*words, "--resume", "--quiet") == (0, "", "")

    best = load_study(tmp_path / "tune" / "best.toml")
    for target, read in (("toml", tomllib.loads), ("json", json.loads)):
        deployed = tmp_path / target
        exported = answer(vsajax("export", result["best"], "--to", target, "-o", deployed, *BRIEF, "--json"))
        artefact, manifest = deployed / f"estimator.{target}", deployed / "manifest.json"
        assert exported["ok"] is True
        assert {str(artefact), str(manifest)} <= set(exported["files"])
        assert {check["name"]: check["state"] for check in exported["checks"]} == {
            "schema": "passed",
            "read back": "passed",
        }
        assert read(artefact.read_text()) == resolved(best)
        facts = json.loads(manifest.read_text())
        assert (facts["format"], facts["files"][0]) == (target, f"estimator.{target}")
        assert facts["study_hash"] == study_hash(best)
        assert facts["sample_time_s"] == best.clock.sample_time
        assert facts["scores"]["held_out"]["mean"] == best.provenance["held_out"]["mean"] == 2.0
        assert facts["checks"] == exported["checks"]
        assert "jax" in facts["versions"]
    assert load_study(tmp_path / "toml" / "estimator.toml") == best
