"""How far a command line comes: all is real up to what computes, which is replaced by a mark."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest

from tuning.files.whole import write_table
from tuning.logs.signal_map import signals_of

COMPUTES = (
    "tuning.problem.replay.simulate",
    "tuning.kinds.log.answer.estimate_recording",
    "tuning.scoring.sweep.GridSweep.open",
    "tuning.scoring.sweep.GridSweep.forecast",
    "tuning.search.refine.tune",
    "tuning.search.blackbox.explore",
    "tuning.scoring.montecarlo.run_population",
    "tuning.scoring.montecarlo.compute_population",
    "tuning.scoring.montecarlo.MonteCarlo.forecast",
    "tuning.scoring.comparison.compare",
    "tuning.search.contest._tune",
    "tuning.kinds.arm.design.design_pose",
    "tuning.kinds.arm.workspace.map_workspace",
    "tuning.kinds.arm.poses.improve_poses",
    "tuning.exports.export._check_folder_is_free",
    "tuning.papers.reproduce_paper",
    "tuning.bench.measure.measure_kernel",
    "tuning.bench.opponent.load_opponent",
)
"""What takes time, by its place; input is read, checked and planned before."""


class Reached(Exception):
    """The command line was taken: what computes was called."""


def reach(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace what computes."""

    def mark(*_args: object, **_options: object) -> None:
        raise Reached

    found = []
    for place in COMPUTES:
        *modules, last = place.split(".")
        owner = modules.pop() if modules[-1][0].isupper() else None
        module = importlib.import_module(".".join(modules))
        holder = getattr(module, owner) if owner else module
        assert hasattr(holder, last), place
        found.append((holder, last))
    # Only now: a module that is imported after a mark was set would keep it for good.
    for holder, last in found:
        monkeypatch.setattr(holder, last, mark)


def write_log(path: Path, kind: str) -> None:
    """Write a recording with every signal of a kind of joint, on a regular clock of 1 ms."""
    time = np.arange(200) * 1e-3
    names = [name for name in signals_of(kind) if not name.startswith("true_")]  # pyright: ignore[reportArgumentType]
    waves = {name: 0.1 * np.sin((3.0 + i) * time) for i, name in enumerate(dict.fromkeys(names))}
    write_table(path, {"time": time, **waves})
