"""From the command to an artefact that its receiver can check."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys

import numpy as np
import pytest

from tests.tuning.builders import ANTAGONISTIC, RESIDUAL_PAIR, SERIAL, SMALL, TINY
from tests.tuning.exports.native import needs_compiler
from tuning.files.shipped import CONFIGS
from tuning.study.base import Config, resolved, study_hash
from tuning.study.loading import load_config

TARGETS = ["toml", "json", "c99", "fmi2", "fmi3", "ros2", "mat", "stablehlo"]
SET = [word for setting in (*SMALL, *TINY) for word in ("--set", setting)]
WINDOW = ["--set", "estimator.side.window=0.3", "--set", "estimator.side.longest_window=0.3"]
SEA_SENSOR = CONFIGS / "tuned" / "sea_sensor.toml"
SHIPPED = {
    "serial": (SERIAL, ()),
    "algebraic": (ANTAGONISTIC, WINDOW),
    "residual pair": (RESIDUAL_PAIR, ()),
    "sensor": (SEA_SENSOR, ()),
    "damping": (CONFIGS / "studies" / "damping.toml", ()),
}


@pytest.fixture(autouse=True)
def _path(monkeypatch, request):
    # The checks run in processes of their own, on the packages of this checkout.
    monkeypatch.setenv("PYTHONPATH", str(request.config.rootpath))


def exported(vsajax, target, folder, *words, config=SERIAL, options=SET):
    """Export and return the manifest."""
    ended = vsajax("export", config, "--to", target, "-o", folder, *options, *words)
    assert (ended.code, ended.err) == (0, ""), ended
    return json.loads((folder / "manifest.json").read_text())


def assert_complete(manifest, folder):
    """See that an export has all that it promises."""
    study = load_config(SERIAL, SET[1::2])
    assert manifest["study_hash"] == study_hash(study)
    assert manifest["sample_time_s"] == 1e-3
    assert manifest["golden"]["samples"] == 101
    assert {row["name"] for row in manifest["inputs"]} == {"dt", *study.estimator.needs}
    assert manifest["valid"]["inputs"].keys() == {row["name"] for row in manifest["inputs"]}
    assert {"stiffness", "stiffness_std", "known"} <= {row["name"] for row in manifest["outputs"]}
    assert [row["unit"] for row in manifest["outputs"]][:3] == ["N·m/rad", "N·m/rad", "N·m"]
    assert "passed" in {check["state"] for check in manifest["checks"]}
    assert "failed" not in {check["state"] for check in manifest["checks"]}
    for name in (*manifest["files"], *manifest["shipped"]):
        assert (folder / name).stat().st_size
    page = (folder / "README.md").read_text()
    assert all(f"`{row['name']}`" in page for row in manifest["parameters"])


@needs_compiler
@pytest.mark.cli
def test_an_fmu_is_complete_and_was_run(vsajax, tmp_path):
    pytest.importorskip("fmpy")
    assert_complete(exported(vsajax, "fmi2", tmp_path, "--duration", "0.1"), tmp_path)


@pytest.mark.slow(twin="tests/tuning/exports/test_families.py::test_every_format_of_every_family_holds")
@needs_compiler
@pytest.mark.cli
@pytest.mark.equivalence
def test_a_pair_with_the_outputs_of_both_sides_passes_the_quick_check_of_its_c(vsajax, tmp_path):
    exported(vsajax, "c99", tmp_path, "--duration", "0.1", config=RESIDUAL_PAIR, options=())
    ended = subprocess.run([sys.executable, "check.py", "--quick"], cwd=tmp_path, capture_output=True, text=True)
    assert ended.returncode == 0, ended
    assert {line.split()[0] for line in ended.stdout.splitlines()} == {"passed"}


@pytest.mark.slow(twin="tests/tuning/exports/test_families.py::test_every_format_of_every_family_holds")
@needs_compiler
@pytest.mark.cli
@pytest.mark.equivalence
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("joint", SHIPPED)
def test_every_format_of_every_joint_holds_over_ten_seconds(vsajax, target, joint, tmp_path):
    config, options = SHIPPED[joint]
    manifest = exported(vsajax, target, tmp_path, "--check", config=config, options=options)
    assert manifest["golden"]["seconds"] == pytest.approx(10.0, abs=0.01)
    states = {check["name"]: check["state"] for check in manifest["checks"]}
    assert "failed" not in states.values(), manifest["checks"]
    lacking = {check["what"] for check in manifest["checks"] if check["state"] == "skipped"}
    allowed = ("not installed", "irregular")
    assert all(any(word in what for word in allowed) for what in lacking), lacking
    assert vsajax("export", tmp_path, "--check").code == 0


@pytest.mark.slow(twin="tests/tuning/exports/test_fmi.py::test_before_the_first_step_it_answers_as_at_rest")
@needs_compiler
@pytest.mark.cli
@pytest.mark.equivalence
@pytest.mark.parametrize("target", ["fmi2", "fmi3"])
def test_a_parameter_of_an_fmu_is_the_one_of_the_study(vsajax, target, tmp_path):
    fmpy = pytest.importorskip("fmpy")
    one, other = tmp_path / "one", tmp_path / "other"
    brief = ("--duration", "0.3")
    exported(vsajax, target, one, *brief)
    changed = ("--set", "estimator.fit.prior_scale=0.01", "--set", "estimator.basis.deflection_scale=0.5")
    exported(vsajax, target, other, *brief, *changed)
    table = np.genfromtxt(other / "golden.csv", delimiter=",", names=True, deletechars="")
    signals = table[["time", "link_position", "motor_position", "elastic_torque"]]
    values = {"fit.prior_scale": 0.01, "basis.deflection_scale": 0.5}
    options = {"step_size": 1e-3, "output_interval": 1e-3, "stop_time": float(table["time"][-1])}
    options |= {"input": signals, "output": ["out.stiffness"]}
    own = fmpy.simulate_fmu(str(one / "awas.fmu"), **options)
    tuned = fmpy.simulate_fmu(str(one / "awas.fmu"), start_values=values, **options)
    recorded = table["out.stiffness"][: len(tuned) - 1]
    typical = np.median(np.abs(recorded))
    assert np.max(np.abs(tuned["out.stiffness"][1:] - recorded)) < 1e-9 * typical
    assert np.max(np.abs(own["out.stiffness"][1:] - recorded)) > 1e-6 * typical


@needs_compiler
@pytest.mark.cli
@pytest.mark.failure
def test_a_receiver_finds_what_was_changed(vsajax, tmp_path):
    assert_complete(exported(vsajax, "c99", tmp_path, "--duration", "0.1"), tmp_path)
    for command in ([sys.executable, "check.py", "--quick"], ["make", "-s", "check"]):
        if shutil.which(command[0]) is None:
            continue
        assert subprocess.run(command, cwd=tmp_path, capture_output=True, check=False).returncode == 0
    source = tmp_path / "awas.c"
    source.write_text(source.read_text().replace("R(1.0) / ", "R(1.00001) / "))
    ended = subprocess.run(
        [sys.executable, "check.py", "--quick"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert ended.returncode == 1
    assert "failed   gcc, double: largest deviation" in ended.stdout


@pytest.mark.cli
@pytest.mark.failure
def test_a_check_that_fails_ends_with_1(vsajax, tmp_path):
    exported(vsajax, "ros2", tmp_path, "--duration", "0.1")
    assert vsajax("export", tmp_path, "--check", "--quiet") == (0, "", "")
    parameters = tmp_path / "awas_params.yaml"
    parameters.write_text(parameters.read_text().replace("prior_scale: 1.0", "prior_scale: 1"))
    ended = vsajax("export", tmp_path, "--check", "--json")
    assert ended.code == 1
    result = json.loads(ended.out)
    assert result["ok"] is False
    assert result["checks"][0]["what"] == "differ: fit.prior_scale"


@pytest.mark.cli
@pytest.mark.failure
def test_no_script_that_somebody_sent_is_run_unless_it_is_trusted(vsajax, tmp_path):
    folder, mark = tmp_path / "sent", tmp_path / "mark"
    exported(vsajax, "ros2", folder, "--duration", "0.1")
    evil = f"open({str(mark)!r}, 'w').close()\n"
    # A module of a package that the check imports.
    (folder / "yaml.py").write_text(evil)
    assert vsajax("export", folder, "--check").code == 0
    assert not mark.exists()
    (folder / "yaml.py").unlink()
    for name in ("checking.py", "check.py"):
        script = folder / name
        own = script.read_text()
        script.write_text(evil + own)
        for _ in range(2):
            ended = vsajax("export", folder, "--check")
            assert (ended.code, ended.out) == (2, "")
            assert f"{script}: is not the script of this version of vsajax" in ended.err
            assert "--trust" in ended.err
        assert not mark.exists()
        assert vsajax("export", folder, "--check", "--trust").code == 0
        assert mark.exists()
        mark.unlink()
        script.write_text(own)
    assert vsajax("export", folder, "--check").code == 0
    assert "--trust is for the check" in vsajax("export", SERIAL, "--to", "json", "-o", folder, "--trust").err


@pytest.mark.cli
@pytest.mark.failure
def test_what_is_no_export_is_named(vsajax, tmp_path):
    ended = vsajax("export", tmp_path, "--check")
    assert (ended.code, ended.out) == (2, "")
    assert f"{tmp_path}: holds no export: it has no manifest.json" in ended.err
    (tmp_path / "manifest.json").write_text("{")
    assert "cannot be read as the manifest of an export" in vsajax("export", tmp_path, "--check").err
    ended = vsajax("export", SERIAL, "--to", "mat", "-o", tmp_path)
    assert "holds a manifest.json of something else" in ended.err
    (tmp_path / "manifest.json").write_text('{"format": "json", "files": ["a.json"], "shipped": []}')
    assert "lacks a.json, which its manifest names" in vsajax("export", tmp_path, "--check").err
    (tmp_path / "a.json").write_text("{}")
    ended = vsajax("export", SERIAL, "--to", "mat", "-o", tmp_path)
    assert (ended.code, ended.out) == (2, "")
    assert "holds an export to json" in ended.err


@pytest.mark.cli
@pytest.mark.failure
def test_a_recording_of_the_users_own_must_have_the_signals(vsajax, tmp_path):
    log = tmp_path / "log.csv"
    log.write_text("time,deflection,motor_torque\n0.0,0.1,0.0\n0.001,0.2,0.0\n0.002,0.1,0.0\n")
    ended = vsajax("export", SEA_SENSOR, "--to", "json", "-o", tmp_path / "out", "--recording", log)
    assert (ended.code, ended.out) == (2, "")
    assert "log.csv: lacks elastic_torque" in ended.err
    assert not (tmp_path / "out").exists()


@pytest.mark.cli
@pytest.mark.failure
def test_an_irregular_recording_is_none_for_what_counts_samples(vsajax, tmp_path):
    log = tmp_path / "log.csv"
    names = ["link_position", *(f"motor{i}_{what}" for what in ("position", "torque") for i in (1, 2))]
    rows = [f"{time}," + ",".join(["0.1"] * len(names)) for time in (0.0, 0.001, 0.002, 0.004)]
    log.write_text("\n".join([",".join(["time", *names]), *rows]) + "\n")
    ended = vsajax("export", ANTAGONISTIC, "--to", "fmi2", "-o", tmp_path / "out", *WINDOW, "--recording", log)
    assert (ended.code, ended.out) == (2, "")
    assert (
        "log.csv: time: steps by 1 to 2 ms, but estimator.side (algebraic) needs a sample every 1 ms" in ended.err
    )
    assert not (tmp_path / "out").exists()


def test_the_schema_refuses_what_the_study_file_refuses(tmp_path):
    jsonschema = pytest.importorskip("jsonschema")
    config = load_config(SEA_SENSOR)
    tables = json.loads(json.dumps(resolved(config)))
    validator = jsonschema.Draft202012Validator(Config.model_json_schema())
    assert not list(validator.iter_errors(tables))
    for path, value in (
        (("fit", "prior_scale"), -1.0),
        (("gate", "spelling"), 1.0),
        (("deflection",), "sideways"),
    ):
        wrong = json.loads(json.dumps(tables))
        table = wrong["estimator"]
        for key in path[:-1]:
            table = table[key]
        table[path[-1]] = value
        assert list(validator.iter_errors(wrong)), path
