"""The sweep of the AwAS study in full: 512 configurations × 64 noise draws × 10 s at 1 kHz."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.tuning.builders import SERIAL

ROOT = Path(__file__).parents[3]


def measured(*words: object) -> tuple[dict, float, int]:
    """Return what a command printed, how long it took [s] and the most memory that it held [bytes]."""
    start = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-c", "from tuning.cli import main; main()", *map(str, words)],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        text=True,
    )
    printed = process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    process.stdout.close()
    process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == 0
    # Linux counts in KiB.
    return json.loads(printed), time.perf_counter() - start, usage.ru_maxrss * 1024


@pytest.mark.benchmark
def test_the_full_sweep_keeps_within_a_minute_and_four_gigabytes_as_it_forecast(tmp_path):
    words = ("sweep", SERIAL, "-o", tmp_path / "run", "--json")
    forecast, _, _ = measured(*words, "--dry-run")
    assert not (tmp_path / "run").exists()
    assert forecast["configurations"] * forecast["scenarios"] == 512 * 64
    _, elapsed, memory = measured(*words)
    print(f"{elapsed:.1f} s of {forecast['run_time']:.1f} s forecast, {memory / 2**30:.2f} GiB of {forecast}")
    assert elapsed < 60.0
    assert memory < 4e9
    assert 0.5 < memory / forecast["memory"] < 2.0
    # Drawing and starting are no part of the forecast of the run; compiling is, from an empty cache.
    assert 0.5 < elapsed / (forecast["run_time"] + forecast["compile_time"]) < 2.0
