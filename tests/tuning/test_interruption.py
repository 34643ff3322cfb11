"""A sweep in a process of its own, interrupted and killed, that goes on to the same bytes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.tuning.builders import NOISE, PRIOR, SERIAL, SMALL, TINY

ROOT = Path(__file__).parents[2]
POINTS = 12
# The installed command, but with one point a chunk, and chunks that last long enough to be cut off.
SLOWED = """
import os, signal, time
from tuning import sweep
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


def start(run: Path, *options: str, pause: float = 0.0) -> subprocess.Popen[str]:
    """Start a sweep that notes in RUN.begun every chunk that it begins."""
    priors = ",".join(f"{0.1 * (i + 1):.1f}" for i in range(POINTS))
    words = [sys.executable, "-c", SLOWED, "sweep", SERIAL, "-o", run, "--scenarios", "2", *options]
    words += ["--grid", f"{PRIOR}={priors}", "--grid", f"{NOISE}=0.01,0.03"]
    words += [word for setting in (*SMALL, *TINY) for word in ("--set", setting)]
    own = {"PYTHONPATH": str(ROOT), "BEGUN": str(begun_in(run)), "PAUSE": str(pause)}
    pipe = subprocess.PIPE
    return subprocess.Popen(list(map(str, words)), env=os.environ | own, stdout=pipe, stderr=pipe, text=True)


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
