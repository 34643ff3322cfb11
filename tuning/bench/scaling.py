"""How the cost of a lane-step depends on lanes, steps, cores and the size of a grid."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from tuning.bench.kernels import KERNELS
from tuning.bench.measure import nanoseconds_per_step, temporary_bytes
from tuning.bench.workload import Workload
from tuning.runs.machine import usable_cores

LANES = (64, 256, 1024, 4096, 16384)
DURATIONS = (1.0, 5.0, 20.0)
DRAWS = (1, 8, 64)
FLAT = 1.5
"""Cost per lane-step may differ by this factor from one number of lanes to another."""
SPEED_UP = 1.7
"""Two cores must be this many times as fast as one."""
CONSTANT = 1.1 / 0.9
"""A gradient's memory may differ by this factor, ±10 %, from one number of samples to another."""
_SCALED = {"awas_plant": 5.0, "serial_estimator": 1.0}
"""Seconds of motion by kernel: a call of a program takes 0.3 ms, which must not count at 64 lanes."""
_SHORT = 0.2
_LANES_OVER_TIME = 256
_REPEATS = 5
_ROUNDS = 5


@dataclass(frozen=True)
class Point:
    """The cost at one size.

    Args:
        kernel: its name.
        axis: "lanes", "steps", "cores" or "grid"; of a grid, the number of configurations times draws.
        value: on the axis.
        cost: at that value.
        unit: "ns" per lane and sample, or "bytes" of temporary memory.
        ok: whether the axis, as far as it has a limit, holds.
        note: why not.
    """

    kernel: str
    axis: str
    value: int
    cost: float
    unit: str
    ok: bool
    note: str


def measure_scaling(kernels: Mapping[str, float] = _SCALED) -> list[Point]:
    """Return the costs of some kernels over every axis, of the sweep over its grid's size, and gradient memory."""
    points: list[Point] = []
    for name, seconds in kernels.items():
        points += _flat(name, "lanes", _costs(name, LANES, seconds), FLAT)
        points += _flat(name, "steps", _over_time(name), FLAT)
        if usable_cores() > 1:
            points += _sped_up(name, seconds)
    sizes = [KERNELS["sweep"].lanes * draws // max(DRAWS) for draws in DRAWS]
    points += _points("sweep", "grid", _costs("sweep", sizes, _SHORT), "ns", None)
    return points + _flat("gradient", "steps", dict(_memory_over_time("gradient")), CONSTANT, "bytes")


def _over_time(name: str) -> dict[int, float]:
    works = [_work(name, _LANES_OVER_TIME, seconds) for seconds in DURATIONS]
    return nanoseconds_per_step({work.samples: work for work in works}, _REPEATS)


def _memory_over_time(name: str) -> Iterator[tuple[int, float]]:
    for seconds in DURATIONS:
        work = _work(name, KERNELS[name].lanes, seconds)
        yield work.samples, float(temporary_bytes(work))


def cost_on(name: str, cores: int, seconds: float) -> float:
    """Return the cost per lane-step in a process of its own that is pinned to so many cores [ns]."""
    code = (
        "import os, json\n"
        f"os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:{cores}])\n"
        "from tuning.runs.machine import start_jax\nstart_jax()\n"
        "from tuning.bench.scaling import _costs\n"
        f"print(json.dumps(_costs({name!r}, [512], {seconds!r})[512]))"
    )
    # The parent's flags ask for the parent's number of devices.
    environment = {key: value for key, value in os.environ.items() if key != "XLA_FLAGS"}
    environment["PYTHONPATH"] = os.pathsep.join(path for path in sys.path if path)
    ended = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    return float(json.loads(ended.stdout))


def _work(name: str, lanes: int, seconds: float) -> Workload:
    return KERNELS[name].prepare(lanes, [f"clock.duration={seconds}"])


def _costs(name: str, lanes: Sequence[int], seconds: float) -> dict[int, float]:
    return nanoseconds_per_step({n: _work(name, n, seconds) for n in lanes}, _REPEATS)


def _flat(name: str, axis: str, costs: Mapping[int, float], limit: float, unit: str = "ns") -> list[Point]:
    reached = max(costs.values()) / min(costs.values())
    note = f"differs by a factor of {reached:.2f}; at most {limit:g} is allowed" if reached > limit else None
    return _points(name, axis, costs, unit, note)


def _sped_up(name: str, seconds: float) -> list[Point]:
    # In turn, so that what else the machine does meets both alike.
    runs = [{cores: cost_on(name, cores, seconds) for cores in (1, 2)} for _ in range(_ROUNDS)]
    best = {cores: min(run[cores] for run in runs) for cores in (1, 2)}
    reached = best[1] / best[2]
    note = f"two cores are {reached:.2f} times as fast; at least {SPEED_UP:g} is asked"
    return _points(name, "cores", best, "ns", note if reached < SPEED_UP else None)


def _points(name: str, axis: str, costs: Mapping[int, float], unit: str, note: str | None) -> list[Point]:
    return [Point(name, axis, value, cost, unit, note is None, note or "") for value, cost in costs.items()]
