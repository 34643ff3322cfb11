"""A grid over any numbers of a study, in resumable chunks."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from tuning.control_problem import problem_of
from tuning.errors import input_error
from tuning.executors import Executor, Inline, complete
from tuning.grid import Grid
from tuning.store import RunStore, open_run, read_table, versions, write_text
from tuning.study import Study, resolved, study_hash, to_toml, with_numbers

_STEPS_PER_CHUNK = 1.0e8
"""Lane-steps in a chunk: a few seconds of work. A constant, so that a resumed run has the same chunks."""


@dataclass(frozen=True)
class Forecast:
    """What a sweep will take, from one timed chunk.

    Args:
        configurations: points of the grid.
        scenarios: noise draws at each.
        chunks: into which the work is cut.
        memory: peak of the process while a chunk runs [bytes].
        compile_time: [s].
        run_time: of all chunks together, compilation apart [s].
    """

    configurations: int
    scenarios: int
    chunks: int
    memory: int
    compile_time: float
    run_time: float


@dataclass(frozen=True)
class GridSweep:
    """A grid and its cut into chunks.

    Args:
        study: the study.
        axes: values by dotted path.
        scenarios: noise draws per configuration.
        cut: outer points of the grid in a chunk; a few seconds of work if `None`.
    """

    study: Study
    axes: Mapping[str, Sequence[float]]
    scenarios: int
    cut: int | None = None

    @classmethod
    def from_plan(cls, study: Study, plan: Mapping[str, Any]) -> GridSweep:
        """Return the sweep that a run's `plan` describes, with the same chunks."""
        return cls(study, plan["axes"], plan["scenarios"], plan["points_per_chunk"])

    @property
    def plan(self) -> dict[str, Any]:
        """What determines the rows beside the study, for the manifest and for other processes."""
        axes = {path: list(values) for path, values in self.axes.items()}
        return {"axes": axes, "scenarios": self.scenarios, "points_per_chunk": self.points_per_chunk}

    @cached_property
    def grid(self) -> Grid:
        """The grid on the study's training stream."""
        return Grid(problem_of(self.study, tuple(self.axes)), self.axes, self.scenarios)

    @cached_property
    def points_per_chunk(self) -> int:
        """Outer points of the grid in a chunk."""
        if self.cut is not None:
            return self.cut
        steps = self.grid.inner_size * self.grid.problem.samples
        return min(max(1, round(_STEPS_PER_CHUNK / steps)), len(self.grid.outer_points))

    @cached_property
    def chunks(self) -> list[str]:
        """Ids of the chunks, in order."""
        count = math.ceil(len(self.grid.outer_points) / self.points_per_chunk)
        return [f"{i:06d}" for i in range(count)]

    def run_chunk(self, chunk: str) -> dict[str, np.ndarray]:
        """Return the rows of a chunk: configuration, scenario, the varied numbers, the scores."""
        first = int(chunk) * self.points_per_chunk
        points = self.grid.outer_points[first : first + self.points_per_chunk]
        configurations = self.grid.configuration_of[first : first + self.points_per_chunk]
        # The last chunk is filled up, so that all chunks are one compiled program.
        filled = points[np.minimum(np.arange(self.points_per_chunk), len(points) - 1)]
        scores = {name: score[: len(points)] for name, score in self.grid.evaluate(filled).items()}
        numbers = configurations.reshape(-1)
        values = {path: np.array([self.grid.values_of(n)[path] for n in numbers]) for path in self.axes}
        return {
            "configuration": np.repeat(numbers, self.scenarios),
            "scenario": np.tile(np.arange(self.scenarios), numbers.size),
            **{path: np.repeat(value, self.scenarios) for path, value in values.items()},
            **{name: score.reshape(-1) for name, score in scores.items()},
        }

    def open(self, folder: Path, *, resume: bool) -> RunStore:
        """Return the run's store."""
        return open_run(folder, "sweep", self.study, self.plan, self.chunks, resume=resume)

    def run(self, store: RunStore, executor: Executor | None = None, *, quiet: bool = False) -> pa.Table:
        """Compute every unfinished chunk, in this process if no executor is given, and return all results."""
        label = f"sweep {self.grid.configurations} × {self.scenarios}"
        return read_table(complete(store, executor or Inline(), label, quiet=quiet))

    def forecast(self) -> Forecast:
        """Compile and time one chunk."""
        import resource

        start = time.perf_counter()
        self.run_chunk(self.chunks[0])
        compiled = time.perf_counter()
        self.run_chunk(self.chunks[0])
        run_time = time.perf_counter() - compiled
        # Linux counts in KiB; the resident peak holds the program, its inputs and one chunk's results.
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
        rows = self.grid.configurations * self.scenarios
        table = rows * 8 * (2 + len(self.axes) + 11) * 3
        return Forecast(
            self.grid.configurations,
            self.scenarios,
            len(self.chunks),
            peak + table,
            compiled - start - run_time,
            run_time * len(self.chunks),
        )


def plan_sweep(study: Study, place: str) -> GridSweep:
    """Return the sweep that a study's `[sweep]` table asks for.

    Raises:
        InputError: the grid is empty.
    """
    if not study.sweep.grid:
        raise input_error(
            f"{place}: sweep.grid",
            "has no axis",
            "add one, or give --grid estimator.fit.prior_scale=log(1e-3,10,8)",
        )
    axes = {path: axis.grid() for path, axis in study.sweep.grid.items()}
    return GridSweep(study, axes, study.sweep.scenarios)


def write_winner(sweep: GridSweep, best: Mapping[str, float], path: Path) -> Path | None:
    """Write the study with a grid's best numbers to the last bit, which `tune`, `simulate` and `export` take.

    Args:
        sweep: the sweep.
        best: the first row of its ranking.
        path: where to.

    Returns:
        The path; `None`, and nothing is written, where no configuration has a score.

    Raises:
        InputError: it cannot be written.
    """
    if math.isnan(best["mean"]):
        return None
    study, values = sweep.study, sweep.grid.values_of(int(best["configuration"]))
    provenance = {
        "command": "sweep",
        "objective": study.tune.objective,
        "study_hash": study_hash(study),
        "seed": study.seed,
        "versions": versions(),
        "swept": sorted(values),
        "scenarios": sweep.scenarios,
        "train": {name: best[name] for name in ("mean", "median", "q90")},
    }
    tables = resolved(with_numbers(study, values, "best of the sweep"))
    write_text(path, to_toml(tables | {"provenance": provenance}))
    return path


def rank(table: pa.Table, axes: Sequence[str], score: str) -> list[dict[str, float]]:
    """Return the configurations, best mean score first, with the mean, median and 90 % quantile over scenarios.

    A configuration with scenarios whose score is not finite, counted under "diverged", has none and goes last.
    """
    values = table[score].to_numpy()
    values = np.where(np.isfinite(values), values, np.nan)
    numbers = table["configuration"].to_numpy()
    order = np.lexsort((table["scenario"].to_numpy(), numbers))
    scenarios = int(table["scenario"].to_numpy().max()) + 1
    per_configuration = values[order].reshape(-1, scenarios)
    firsts = order[::scenarios]
    rows = [
        {
            "configuration": int(numbers[first]),
            **{path: float(table[path][int(first)].as_py()) for path in axes},
            "mean": float(np.mean(scores)),
            "median": float(np.median(scores)),
            "q90": float(np.quantile(scores, 0.9)),
            "diverged": int(np.sum(np.isnan(scores))),
        }
        for first, scores in zip(firsts, per_configuration, strict=True)
    ]
    return sorted(rows, key=lambda row: (math.isnan(row["mean"]), row["mean"]))
