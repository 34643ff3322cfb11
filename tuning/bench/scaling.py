"""How the cost of a lane-step depends on lanes, steps, cores and the size of a grid."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import dataclass

from tuning.bench.kernels import KERNELS
from tuning.bench.measure import nanoseconds_per_step
from tuning.runtime import usable_cores

LANES = (64, 256, 1024, 4096, 16384)
DURATIONS = (0.5, 2.0, 8.0)
DRAWS = (1, 8, 64)
FLAT = 1.5
"""Cost per lane-step may differ by this factor from one number of lanes to another."""
SPEED_UP = 1.7
"""Two cores must be this many times as fast as one."""
_SCALED = ("awas_plant", "serial_estimator")
_SHORT = "clock.duration=0.2"
_REPEATS = 5


@dataclass(frozen=True)
class Point:
    """The cost at one size.

    Args:
        kernel: its name.
        axis: "lanes", "steps", "cores" or "grid".
        value: on the axis; of a grid, the number of configurations times draws.
        ns_per_step: per lane and sample [ns].
        ok: whether the axis, as far as it has a limit, holds.
        note: why not.
    """

    kernel: str
    axis: str
    value: int
    ns_per_step: float
    ok: bool = True
    note: str = ""


def measure_scaling(kernels: tuple[str, ...] = _SCALED) -> list[Point]:
    """Return the costs of some kernels over every axis, and of the sweep over its grid's size."""
    points: list[Point] = []
    for name in kernels:
        points += _judged(name, "lanes", {lanes: _cost(name, lanes, _SHORT) for lanes in LANES})
        for seconds in DURATIONS:
            work = KERNELS[name].prepare(64, [f"clock.duration={seconds}"])
            points.append(Point(name, "steps", work.samples, nanoseconds_per_step(work, _REPEATS)))
        if usable_cores() > 1:
            points += _judged(name, "cores", {cores: cost_on(name, cores) for cores in (1, 2)})
    for draws in DRAWS:
        work = KERNELS["sweep"].prepare(KERNELS["sweep"].lanes * draws // max(DRAWS), [_SHORT])
        points.append(Point("sweep", "grid", work.lanes, nanoseconds_per_step(work, _REPEATS)))
    return points


def cost_on(name: str, cores: int) -> float:
    """Return the cost per lane-step in a process of its own that is pinned to so many cores [ns]."""
    code = (
        "import os, json\n"
        f"os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:{cores}])\n"
        "from tuning.runtime import start_jax\nstart_jax()\n"
        "from tuning.bench.scaling import _cost\n"
        f"print(json.dumps(_cost({name!r}, 512, 'clock.duration=1.0')))"
    )
    # The parent's flags ask for the parent's number of devices.
    environment = {key: value for key, value in os.environ.items() if key != "XLA_FLAGS"}
    environment["PYTHONPATH"] = os.pathsep.join(path for path in sys.path if path)
    ended = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    return float(json.loads(ended.stdout))


def _cost(name: str, lanes: int, setting: str) -> float:
    return nanoseconds_per_step(KERNELS[name].prepare(lanes, [setting]), _REPEATS)


def _judged(name: str, axis: str, costs: dict[int, float]) -> list[Point]:
    if axis == "lanes":
        reached = max(costs.values()) / min(costs.values())
        ok, note = reached <= FLAT, f"differs by a factor of {reached:.2f}; at most {FLAT:g} is allowed"
    else:
        reached = costs[1] / costs[2]
        ok, note = (
            reached >= SPEED_UP,
            f"two cores are {reached:.2f} times as fast; at least {SPEED_UP:g} is asked",
        )
    return [Point(name, axis, value, cost, ok, "" if ok else note) for value, cost in costs.items()]
