"""A sweep that is interrupted, killed, or without room on the disk, and goes on to the same bytes."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pyarrow.parquet as pq
import pytest

from tests.tuning.builders import NOISE, PRIOR, SERIAL, SMALL, TINY
from tuning.scoring import sweep

ROOT = Path(__file__).parents[2]
POINTS = 12
# The installed command, but with one point a chunk, and chunks that last long enough to be cut off.
SLOWED = """
import os, signal, time
from tuning.scoring import sweep
from tuning.cli import main

sweep._STEPS_PER_CHUNK = 1.0
compute = sweep.GridSweep.run_chunk

def run_chunk(self, chunk):
    with open(os.environ["BEGUN"], "a") as begun:
        print(chunk, file=begun)
    time.sleep(float(os.environ["PAUSE"]))
    return compute(self, chunk)

sweep.GridSweep.run_chunk = run_chunk
# A job in the background is started with interrupts ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)
main()
"""


def words_of(run: Path, *options: object) -> list[str]:
    """Return the arguments of a sweep of `POINTS` points; later options override."""
    priors = ",".join(f"{0.1 * (i + 1):.1f}" for i in range(POINTS))
    words = ["sweep", SERIAL, "-o", run, "--scenarios", "2"]
    words += ["--grid", f"{PRIOR}={priors}", "--grid", f"{NOISE}=0.01,0.03"]
    words += [word for setting in (*SMALL, *TINY) for word in ("--set", setting)]
    return list(map(str, [*words, *options]))


def start(run: Path, *options: object, pause: float = 0.0) -> subprocess.Popen[str]:
    """Start a sweep that notes in RUN.begun every chunk that it begins."""
    own = {"PYTHONPATH": str(ROOT), "BEGUN": str(begun_in(run)), "PAUSE": str(pause)}
    return subprocess.Popen(
        [sys.executable, "-c", SLOWED, *words_of(run, *options)],
        env=os.environ | own,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # A group of its own, which can be interrupted as a terminal does it: with all its workers.
        process_group=0,
    )


def contents(run: Path) -> dict[str, bytes]:
    """Return what may not depend on interruptions, by file."""
    return {path.name: path.read_bytes() for path in run.rglob("*.parquet") if not path.name.startswith(".")}


def members(group: int) -> list[psutil.Process]:
    """Return the living processes of a group."""
    found = []
    for process in psutil.process_iter(["status"]):
        with contextlib.suppress(ProcessLookupError):
            if os.getpgid(process.pid) == group and process.info["status"] != psutil.STATUS_ZOMBIE:
                found.append(process)
    return found


def begun_in(run: Path) -> Path:
    return run.with_suffix(".begun")


def finished_in(run: Path) -> set[str]:
    return {path.stem for path in (run / "chunks").glob("*.parquet") if not path.name.startswith(".")}


def wait_for(process: subprocess.Popen[str], run: Path, chunks: int) -> None:
    """Wait until the run has finished so many chunks, and not yet all."""
    deadline = time.monotonic() + 120.0
    while len(finished_in(run)) < chunks:
        assert process.poll() is None, process.communicate()[1]
        assert time.monotonic() < deadline
        time.sleep(0.01)
    assert len(finished_in(run)) < POINTS


@pytest.mark.slow(
    twin="tests/tuning/test_sweep.py::test_a_run_that_was_cut_off_goes_on_to_the_same_bytes_and_computes_only_what_is_missing"
)
@pytest.mark.cli
@pytest.mark.equivalence
def test_a_sweep_that_is_interrupted_and_killed_ends_with_the_same_bytes(tmp_path):
    straight = start(tmp_path / "straight", "--quiet")
    out, err = straight.communicate()
    assert (straight.returncode, out, err) == (0, "", "")

    run = tmp_path / "cut"
    interrupted = start(run, pause=0.2)
    wait_for(interrupted, run, 2)
    interrupted.send_signal(signal.SIGINT)
    out, err = interrupted.communicate()
    assert interrupted.returncode == 3
    assert out == ""
    assert "run the same command with --resume" in err
    assert "Traceback" not in err
    after_interrupt = finished_in(run)

    killed = start(run, "--resume", pause=0.2)
    wait_for(killed, run, len(after_interrupt) + 2)
    killed.kill()
    killed.communicate()
    assert killed.returncode == -signal.SIGKILL
    after_kill = finished_in(run)
    assert after_interrupt < after_kill
    assert not (run / "results.parquet").exists()

    begun_before = begun_in(run).read_text().split()
    resumed = start(run, "--resume", "--json")
    out, err = resumed.communicate()
    assert (resumed.returncode, err) == (0, "")
    assert json.loads(out)["results"] == str(run / "results.parquet")
    for name in ("results.parquet", *(f"chunks/{chunk}.parquet" for chunk in sorted(finished_in(run)))):
        assert (run / name).read_bytes() == (tmp_path / "straight" / name).read_bytes()

    # No finished chunk was begun again, and the last process began exactly what was missing.
    begun = begun_in(run).read_text().split()
    assert set(begun[len(begun_before) :]) == finished_in(run) - after_kill
    assert len(begun) <= POINTS + 2


# Long enough for workers, which know nothing of a pause, to be caught at it.
LASTING = ("--scenarios", "512", "--set", "clock.duration=4.0")


@pytest.mark.cli
@pytest.mark.equivalence
@pytest.mark.slow(
    twin=(
        "tests/tuning/test_executors.py::test_workers_give_the_bytes_of_a_run_in_one_process",
        "tests/tuning/test_executors.py::test_an_interrupt_while_workers_start_is_neither_lost_nor_theirs",
    )
)
@pytest.mark.parametrize("chunks", [0, 1])
def test_workers_stop_with_a_sweep_that_is_interrupted_and_one_that_goes_on_gives_the_same_bytes(tmp_path, chunks):
    straight = start(tmp_path / "straight", *LASTING, "--quiet")
    assert (*straight.communicate(), straight.returncode) == ("", "", 0)

    run = tmp_path / "cut"
    interrupted = start(run, *LASTING, "--workers", 2)
    # The host and two workers at least; without a chunk they are caught while they start.
    while len(members(interrupted.pid)) < 3:
        assert interrupted.poll() is None, interrupted.communicate()[1]
        time.sleep(0.01)
    wait_for(interrupted, run, chunks)
    os.killpg(interrupted.pid, signal.SIGINT)
    out, err = interrupted.communicate(timeout=60)
    assert (interrupted.returncode, out) == (3, "")
    assert err.split("\n") == ["", "interrupted; finished work is kept: run the same command with --resume", ""]
    wait_until_gone(interrupted.pid)

    resumed = start(run, *LASTING, "--workers", 2, "--resume", "--quiet")
    assert (*resumed.communicate(), resumed.returncode) == ("", "", 0)
    assert contents(run) == contents(tmp_path / "straight")


@pytest.mark.cli
@pytest.mark.slow(
    twin=(
        "tests/tuning/test_executors.py::test_workers_give_the_bytes_of_a_run_in_one_process",
        "tests/tuning/test_executors.py::test_an_interrupt_while_workers_start_is_neither_lost_nor_theirs",
    )
)
def test_workers_do_not_outlive_a_sweep_that_is_killed(tmp_path):
    killed = start(tmp_path / "run", *LASTING, "--workers", 2)
    wait_for(killed, tmp_path / "run", 1)
    assert len(members(killed.pid)) >= 3
    killed.kill()
    killed.communicate()
    wait_until_gone(killed.pid)


def wait_until_gone(group: int) -> None:
    """Wait until no process of a group is left."""
    deadline = time.monotonic() + 30.0
    while members(group):
        assert time.monotonic() < deadline, [process.cmdline() for process in members(group)]
        time.sleep(0.05)


@pytest.mark.cli
@pytest.mark.equivalence
@pytest.mark.slow(
    twin="tests/tuning/test_sweep.py::test_a_run_that_was_cut_off_goes_on_to_the_same_bytes_and_computes_only_what_is_missing"
)
def test_a_sweep_killed_at_any_instant_leaves_a_folder_that_can_be_resumed(tmp_path):
    def in_one_go(name: str) -> float:
        begun = time.monotonic()
        straight = start(tmp_path / name, "--quiet", pause=0.1)
        assert (straight.communicate()[0], straight.returncode) == ("", 0)
        return time.monotonic() - begun

    in_one_go("compiling")
    lasted = in_one_go("straight")
    expected = contents(tmp_path / "straight")
    assert contents(tmp_path / "compiling") == expected

    # One folder is killed again and again until it gets done, then the next.
    runs, left = [tmp_path / "killed-0"], []
    for i, share in enumerate(np.random.default_rng(7).random(20)):
        run = runs[-1]
        before = finished_in(run)
        killed = start(run, "--quiet", "--resume", pause=0.1)
        # Most of the time is spent before this process has its first chunk; every other time, no kill falls there.
        while i % 2 and killed.poll() is None and finished_in(run) == before:
            time.sleep(0.01)
        with contextlib.suppress(subprocess.TimeoutExpired):
            killed.wait(share * (1.2 if i % 2 else lasted))
        killed.kill()
        killed.communicate()
        assert killed.returncode in {0, -signal.SIGKILL}
        left.append(len(finished_in(run)))
        # What is there is there whole.
        assert all(written == expected[name] for name, written in contents(run).items())
        if killed.returncode == 0:
            runs.append(tmp_path / f"killed-{len(runs)}")
    for run in runs:
        resumed = start(run, "--quiet", "--resume")
        assert (resumed.communicate()[0], resumed.returncode) == ("", 0)
        assert contents(run) == expected
    assert {0 < chunks < POINTS for chunks in left} == {False, True}, left


@pytest.fixture
def disk(tmp_path):
    """A small disk of its own, which grows when it is called with a size [KiB]."""
    place = tmp_path / "disk"
    place.mkdir()

    def mount(options: str) -> subprocess.CompletedProcess[str]:
        words = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(place)]
        return subprocess.run(words, capture_output=True, text=True, check=False)

    try:
        mounted = mount("size=8k")
    except FileNotFoundError:
        pytest.skip("needs the command mount")
    if mounted.returncode:
        pytest.skip(f"needs to mount a small disk, which this user may not: {mounted.stderr.strip()}")

    def grow(size: int) -> Path:
        assert mount(f"remount,size={size}k").returncode == 0
        return place

    yield grow
    subprocess.run(["umount", str(place)], check=True)


@pytest.mark.cli
@pytest.mark.failure
@pytest.mark.equivalence
def test_a_full_disk_ends_with_2_and_the_run_goes_on_when_there_is_room(vsajax, disk, tmp_path, monkeypatch):
    monkeypatch.setattr(sweep, "_STEPS_PER_CHUNK", 1.0)
    assert vsajax(*words_of(tmp_path / "straight", "--quiet")) == (0, "", "")
    expected = contents(tmp_path / "straight")
    full = []
    # At every stage: the manifest, the chunks, the results and the picture.
    for size in range(4, 400, 16):
        run = disk(size) / "run"
        ended = vsajax(*words_of(run, "--quiet", "--resume"))
        if ended.code == 0:
            break
        assert (ended.code, ended.out) == (2, "")
        assert "cannot be written (No space left on device)" in ended.err
        full.append(ended.err.removeprefix(f"error: {run}/").partition(":")[0])
        assert all(written == expected[name] for name, written in contents(run).items())
        # Nothing half written takes the room.
        assert [path for path in run.rglob(".*")] == []
    assert ended == (0, "", "")
    assert contents(run) == expected
    assert {Path(name).parts[0] for name in full} >= {"manifest.json", "chunks", "figures"}
    assert pq.ParquetFile(run / "results.parquet").metadata.num_rows == 4 * POINTS
