"""How the command is entered, and what is said where its answer cannot be written or its cache not be read."""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from tuning.runs.machine import heal_cache

ROOT = Path(__file__).parents[3]
FULL = Path("/dev/full")


def shell(*words: object, out: object = subprocess.PIPE, err: object = subprocess.PIPE) -> tuple[int, str, str]:
    """Run `python -m` on the packages of this checkout, the answer going to `out`."""
    ended = subprocess.run(
        [sys.executable, "-m", *map(str, words)],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=out,  # pyright: ignore
        stderr=err,  # pyright: ignore
        text=True,
        check=False,
        timeout=120,
    )
    return ended.returncode, ended.stdout or "", ended.stderr or ""


@pytest.mark.cli
@pytest.mark.parametrize("package", ["vsajax", "tuning"])
def test_each_package_is_a_command(package):
    code, out, err = shell(package, "--version")
    assert (code, out.split(",")[0], err) == (0, "vsajax", "")


@pytest.mark.cli
@pytest.mark.failure
@pytest.mark.skipif(not FULL.exists(), reason="this system has no full device")
@pytest.mark.parametrize("words", [("check", "shipped:sea"), ("--help",), ("init", "--list", "--json")])
def test_a_full_disk_behind_the_answer_is_bad_input_by_its_place(words):
    with FULL.open("w") as full:
        code, _, err = shell("tuning", *words, out=full)
    assert code == 2
    assert err.startswith("error: standard output: cannot be written (No space left on device)\n    fix: ")
    assert err.count("\n") == 2


@pytest.mark.cli
@pytest.mark.failure
@pytest.mark.skipif(not FULL.exists(), reason="this system has no full device")
def test_a_mistake_that_nobody_can_be_told_still_ends_with_2():
    with FULL.open("w") as full:
        assert shell("tuning", "check", "none.toml", err=full)[0] == 2
        assert shell("tuning", "nonsense", err=full)[0] == 2


@pytest.mark.cli
@pytest.mark.failure
def test_a_reader_that_leaves_early_is_no_mistake():
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "w") as broken:
        _, _, err = shell("tuning", "check", "shipped:sea", out=broken)
    assert err == ""


@pytest.mark.cli
@pytest.mark.failure
def test_a_recorded_torque_is_opened_by_check_and_its_column_named(vsajax, tmp_path):
    log = tmp_path / "torque.csv"
    log.write_text("time,torque\n0,0\n1,1\n2,1\n")
    setting = f"excitation.motor={{type='file',path='{log}'}}"
    ended = vsajax("check", "shipped:sea", "--set", setting)
    assert ended.code == 2
    assert ended.err.startswith(f"error: {log}: no column motor_torque\n    fix: did you mean 'torque'?")
    assert 'column = "…" beside path' in ended.err
    assert vsajax("check", "shipped:sea", "--set", setting.replace("}", ",column='torque'}")).code == 0
    log.unlink()
    assert f"error: {log}: no such file" in vsajax("check", "shipped:sea", "--set", setting).err


@pytest.mark.failure
@pytest.mark.parametrize(
    ("is_there", "words"), [(True, "was damaged and has been emptied"), (False, "cannot be used (No such file")]
)
def test_a_broken_compile_cache_is_healed_with_one_line(tmp_path, capsys, is_there, words):
    folder = tmp_path / "cache"
    if is_there:
        folder.mkdir()
        (folder / "jit_f-1-cache").write_bytes(b"junk")
        (folder / "other.txt").touch()
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        heal_cache(folder)
        for name in ("f", "g"):
            warnings.warn(f"Error reading persistent compilation cache entry for 'jit_{name}': bad", stacklevel=1)
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"note: the compile cache {folder} {words}")
    assert not is_there or [path.name for path in folder.iterdir()] == ["other.txt"]
