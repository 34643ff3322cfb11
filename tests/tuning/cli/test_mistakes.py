"""A user's mistakes: exit code 2, one message with the place and the way out, no traceback, nothing written."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.tuning.builders import GAIN, PRIOR, SEA, SERIAL, SMALL, TINY
from tuning.files.shipped import CONFIGS
from tuning.files.whole import write_table

CONFIG = CONFIGS / "tuned" / "sea_sensor.toml"
HEBI = Path(__file__).parents[2] / "golden" / "hebi" / "exampleLog.csv"
BRIEF = ("--duration", "0.1")
SHORT = [word for setting in (*SMALL, *TINY) for word in ("--set", setting)]


@pytest.fixture
def refused(vsajax, tmp_path, monkeypatch):
    """Run a command that must be refused, in a folder that must stay as it is; return its message."""
    monkeypatch.chdir(tmp_path)

    def call(*words: object) -> str:
        before = snapshot(tmp_path)
        ended = vsajax(*words)
        assert (ended.code, ended.out) == (2, "")
        assert ended.err.startswith("error: ")
        assert snapshot(tmp_path) == before
        return ended.err

    return call


def snapshot(folder: Path) -> dict[str, bytes | None]:
    return {str(path): path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


each_command = pytest.mark.parametrize(
    "command",
    [
        "check study.toml",
        "simulate study.toml -o recording.csv",
        "sweep study.toml -o run",
        "tune study.toml -o run",
        "export study.toml --to json -o deploy",
        f"estimate {HEBI} -c study.toml -o estimate.csv",
    ],
    ids=lambda command: command.split()[0],
)
MISTAKES = {
    "unknown key": (
        "damping = 0.1 ",
        "dampign = 0.1 ",
        ["joint.link.dampign: unknown key", "did you mean damping?"],
    ),
    "wrong type": ("inertia = 0.05", 'inertia = "0.05"', ["joint.link.inertia: got '0.05'", "a valid number"]),
    "negative inertia": ("inertia = 0.05", "inertia = -0.05", ["joint.link.inertia: got -0.05", "greater than 0"]),
    "c <= 0": (
        "prior_scale = 1e4",
        'prior_scale = 1e4\nlaw = { type = "enhanced", constant = 0.0 }',
        ["estimator.fit.law.constant: got 0.0", "greater than 0"],
    ),
    "prior <= 0": ("prior_scale = 1e4", "prior_scale = -1e4", [f"{PRIOR}: got -10000.0", "greater than 0"]),
    "not TOML": ("seed = 0", "seed = = 0", ["is not valid TOML", "line 7, column 8"]),
}


@pytest.mark.failure
@pytest.mark.cli
@each_command
@pytest.mark.parametrize("mistake", MISTAKES)
def test_every_command_names_a_mistake_in_a_study(command, mistake, refused, tmp_path):
    old, new, said = MISTAKES[mistake]
    text = SEA.read_text()
    assert text.count(old) == 1
    (tmp_path / "study.toml").write_text(text.replace(old, new))
    message = refused(*command.split())
    for word in ("error: study.toml: ", *said):
        assert word in message


@pytest.mark.failure
@pytest.mark.cli
@each_command
def test_every_command_names_a_file_that_holds_no_study(command, refused, tmp_path):
    assert "study.toml: no such file" in refused(*command.split())
    (tmp_path / "study.toml").write_text("")
    assert "study.toml: is empty\n    fix: start from `vsajax init KIND FILE`" in refused(*command.split())
    (tmp_path / "study.toml").unlink()
    (tmp_path / "study.toml").mkdir()
    assert "study.toml: is a directory\n    fix: name a file in it" in refused(*command.split())


def recording(**columns: list[float] | None) -> dict[str, np.ndarray]:
    """Return a small canonical recording with some columns replaced, or left out."""
    whole = {
        "time": [0.0, 0.1, 0.2, 0.3],
        "deflection": [0.0, 1.0, 2.0, 3.0],
        "elastic_torque": [0.0, 1.0, 2.0, 3.0],
    }
    return {name: np.array(values) for name, values in (whole | columns).items() if values is not None}


RECORDINGS = {
    "missing column": (
        recording(deflection=None),
        ["no column deflection", "present: time, elastic_torque"],
    ),
    "missing clock": (recording(time=None), ["no column time"]),
    "repeated time": (recording(time=[0.0, 0.1, 0.1, 0.3]), ["time must strictly increase", "goes from 0.1"]),
    "time runs back": (recording(time=[0.0, 0.2, 0.1, 0.3]), ["time must strictly increase", "at 1 of 4 samples"]),
    "NaN": (recording(deflection=[0.0, np.nan, 2.0, 3.0]), ["column 'deflection' has no value or NaN"]),
    "infinity": (recording(elastic_torque=[0.0, 1.0, 2.0, np.inf]), ["column 'elastic_torque' has inf"]),
    "text": (recording(elastic_torque=["0", "1", "two", "3"]), ["column 'elastic_torque' has 'two'"]),
    "too short": ({name: values[:2] for name, values in recording().items()}, ["2 samples are left"]),
    "no samples": ({name: values[:0] for name, values in recording().items()}, ["has a header but no samples"]),
}
PLACES = {"repeated time": 3, "time runs back": 3, "NaN": 2, "infinity": 4, "text": 3}


@pytest.mark.failure
@pytest.mark.cli
@pytest.mark.parametrize("suffix", ["csv", "parquet"])
@pytest.mark.parametrize("mistake", RECORDINGS)
def test_a_mistake_in_a_recording_is_named(mistake, suffix, refused, tmp_path):
    columns, said = RECORDINGS[mistake]
    write_table(tmp_path / f"log.{suffix}", columns)
    message = refused("estimate", f"log.{suffix}", "-c", CONFIG, "-o", "estimate.csv")
    row = PLACES.get(mistake)
    # The header is line 1 of a CSV.
    place = "" if row is None else f": line {row + 1}" if suffix == "csv" else f": row {row}"
    for word in (f"error: log.{suffix}{place}: ", *said, "\n    fix: "):
        assert word in message


@pytest.mark.failure
@pytest.mark.cli
def test_a_file_that_holds_no_recording_is_named(refused, tmp_path):
    for name in ("zero.parquet", "zero.csv"):
        (tmp_path / name).write_bytes(b"")
        assert f"{name}: is empty (0 bytes)" in refused("estimate", name, "-c", CONFIG)
    (tmp_path / "text.parquet").write_text("time,deflection\n0,1\n")
    assert "text.parquet: cannot be read as a Parquet file" in refused("estimate", "text.parquet", "-c", CONFIG)
    (tmp_path / "folder.csv").mkdir()
    assert "folder.csv: is a directory" in refused("estimate", "folder.csv", "-c", CONFIG)
    assert "did you mean zero.csv?" in refused("estimate", "zeros.csv", "-c", CONFIG)
    assert "log.xlsx: unknown suffix '.xlsx'" in refused("estimate", "log.xlsx", "-c", CONFIG)


@pytest.mark.failure
@pytest.mark.cli
def test_a_signal_that_the_estimator_needs_is_looked_for_before_it_runs(refused, tmp_path):
    text = (CONFIGS / "logs" / "hebi.toml").read_text()
    signal_map = tmp_path / "hebi.toml"
    signal_map.write_text(text[: text.index("[signals.motor_position]")])
    message = refused("estimate", HEBI, "-c", CONFIG, "--map", signal_map, "--set", "estimator.deflection=raw")
    assert f"{HEBI}: motor_position: is missing, but the estimator needs this signal" in message
    assert "record or map it" in message
    assert "--select force: is not of the form COLUMN=VALUE" in refused(
        "estimate", HEBI, "-c", CONFIG, "--select", "force"
    )


@pytest.mark.failure
@pytest.mark.cli
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("init", "leg"), ["KIND: got 'leg'", "allowed: ", "serial"]),
        (("init", "serial", "taken.toml"), ["taken.toml: exists already"]),
        (("init", "serial", "taken.toml/study.toml"), ["taken.toml/study.toml: cannot be written"]),
        (("simulate", SERIAL, "-o", "r.txt"), ["r.txt: unknown suffix '.txt'"]),
        (("simulate", SERIAL, "-o", "taken.toml/r.csv", *SHORT), ["taken.toml/r.csv: cannot be written"]),
        (("estimate", HEBI, "-c", CONFIG, "-o", "e.txt"), ["e.txt: unknown suffix '.txt'"]),
        (("sweep", SERIAL, "-o", "taken.toml", *SHORT, "--grid", f"{PRIOR}=1"), ["taken.toml: is a file"]),
        (("sweep", SERIAL, "-o", ".", *SHORT, "--grid", f"{PRIOR}=1"), [".: is not empty and holds no run"]),
        (("sweep", SERIAL, "-o", "run", *SHORT), [f"{SERIAL}: sweep.grid: has no axis", "--grid"]),
        (("sweep", SERIAL, "-o", "run", "--grid", PRIOR), ["is not of the form a.b=values", "e.g. --grid"]),
        (("sweep", SERIAL, "-o", "run", "--grid", "estimator.fit.prior=1"), ["leads to no number", PRIOR]),
        (("sweep", SERIAL, "-o", "run", "--grid", f"{PRIOR}=0,1"), ["reaches 0, which is not allowed there"]),
        (("sweep", SERIAL, "-o", "run", "--grid", f"{GAIN}=log(0,1,3)"), ["a log range must be positive"]),
        (("tune", SERIAL, "-o", ".", *SHORT), [f"{SERIAL}: tune.parameters: names no number to tune"]),
        (("export", SERIAL, "--to", "toml", "-o", "taken.toml"), ["taken.toml: is a file, not a folder"]),
    ],
    ids=lambda value: " ".join(map(str, value[:2])) if isinstance(value, tuple) else None,
)
def test_what_cannot_be_done_is_named(words, said, refused, tmp_path):
    (tmp_path / "taken.toml").write_text("mine")
    message = refused(*words)
    for word in said:
        assert word in message


@pytest.mark.failure
@pytest.mark.cli
def test_steps_too_coarse_for_the_joint_are_refused(refused):
    coarse = ("--set", "substeps=1", "--set", "joint.spring.spring_rate=1e8")
    message = refused("simulate", SERIAL, "-o", "recording.csv", *SHORT, *coarse)
    assert "substeps: got 1: a step of 0.001 s, and the integration is unstable above" in message
    assert "allowed: at least" in message


@pytest.mark.slow(
    twin=(
        "tests/tuning/test_store.py::test_a_full_disk_leaves_a_chunk_pending_and_no_scraps",
        "tests/tuning/test_store.py::test_a_text_that_cannot_be_written_leaves_the_old_one_and_no_scraps",
    )
)
@pytest.mark.failure
@pytest.mark.cli
def test_a_full_disk_ends_with_2_and_leaves_no_half_of_a_file(vsajax, monkeypatch, tmp_path):
    def refuse(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", refuse)
    for words in (
        ("init", "serial", tmp_path / "study.toml"),
        ("export", SERIAL, "--to", "json", "-o", tmp_path / "deploy", *BRIEF),
        ("sweep", SERIAL, "-o", tmp_path / "run", *SHORT, "--grid", f"{PRIOR}=1,2"),
    ):
        ended = vsajax(*words)
        assert (ended.code, ended.out) == (2, "")
        assert "cannot be written (No space left on device)" in ended.err
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


@pytest.mark.parametrize(
    "words",
    [("check",), ("sweep", "-o", "run"), ("export", "--to", "ros2", "-o", "out"), ("estimate", "-c", "c.toml")],
)
def test_a_file_name_that_is_no_text_is_refused_by_name(vsajax, words, tmp_path):
    path = os.fsdecode(os.fsencode(tmp_path / "study") + b"\xff.toml")
    shutil.copy(SERIAL, path)
    ended = vsajax(words[0], path, *words[1:])
    assert (ended.code, ended.out) == (2, "")
    assert r"study\udcff.toml: is not UTF-8 text" in ended.err
