"""A grid over any numbers and settings of a study, in resumable chunks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from tuning.files.errors import input_error
from tuning.files.whole import write_text
from tuning.problem.interface import problem_of
from tuning.runs.executors import Executor, Inline, complete
from tuning.runs.folder import RunStore, open_run
from tuning.runs.forecast import Forecast, foresee
from tuning.runs.manifest import versions
from tuning.runs.sealed import read_table
from tuning.scoring.grid import Grid
from tuning.study.base import Study, descended, study_hash, to_toml
from tuning.study.choices import Setting, options_of
from tuning.study.loading import with_numbers
from tuning.study.paths import contested_number, numeric_paths, structural_paths
from tuning.study.scores import SCORES
from tuning.study.structures import grid_structures

Value = float | Setting
"""Of an axis."""

_STEPS_PER_CHUNK = 1.0e8
"""Lane-steps in a chunk: a few seconds of work. A constant, so that a resumed run has the same chunks."""


@dataclass(frozen=True)
class Structure:
    """The part of a sweep that one program computes: all points with the same settings.

    Args:
        study: the study with these settings.
        chosen: the settings by path; empty where the grid varies numbers only.
        grid: of the axes that lead to numbers of this study.
        axes: all axes of the sweep, in order.
    """

    study: Study
    chosen: Mapping[str, Setting]
    grid: Grid
    axes: Mapping[str, Sequence[Value]]

    @cached_property
    def configurations(self) -> np.ndarray:
        """`(outer point, inner point)` numbers of the configurations, as the sweep counts them.

        Along an axis that leads to no number here there is one point only, the axis' first.
        """
        own = np.unravel_index(
            self.grid.configuration_of, [len(values) for values in self.grid.axes.values()] or [1]
        )
        places = dict(zip(self.grid.axes, own, strict=False))
        at = [
            np.full(self.grid.configuration_of.shape, list(values).index(self.chosen[path]))
            if path in self.chosen
            else places.get(path, np.zeros_like(self.grid.configuration_of))
            for path, values in self.axes.items()
        ]
        return np.ravel_multi_index(at, [len(values) for values in self.axes.values()])

    def columns_of(self, configurations: np.ndarray) -> dict[str, np.ndarray]:
        """Return the varied values of configurations by path; NaN where a number does not exist here."""
        at = np.unravel_index(configurations, [len(values) for values in self.axes.values()])
        found = {}
        for (path, values), place in zip(self.axes.items(), at, strict=True):
            has_it = path in self.chosen or path in self.grid.axes
            found[path] = np.array(values)[place] if has_it else np.full(place.shape, np.nan)
        return found


@dataclass(frozen=True)
class GridSweep:
    """A grid and its cut into chunks: structure after structure, each a grid of numbers.

    Args:
        study: the study; its `[sweep]` has the axes too.
        axes: values by dotted path, the last running fastest.
        scenarios: noise draws per configuration.
        cut: outer points of a grid in a chunk; a few seconds of work if `None`.
    """

    study: Study
    axes: Mapping[str, Sequence[Value]]
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
    def structures(self) -> list[Structure]:
        """The parts that are programs of their own, on the study's training stream."""
        found = []
        for chosen, study in grid_structures(self.study, "sweep.grid"):
            numbers = numeric_paths(study)
            axes = {path: [float(v) for v in values] for path, values in self.axes.items() if path in numbers}
            grid = Grid(problem_of(study, tuple(axes)), axes, self.scenarios)
            found.append(Structure(study, chosen, grid, self.axes))
        return found

    @property
    def configurations(self) -> int:
        """Number of points of the grid; along an axis that a structure lacks it has one."""
        return sum(structure.grid.configurations for structure in self.structures)

    @cached_property
    def points_per_chunk(self) -> int:
        """Outer points of a grid in a chunk."""
        if self.cut is not None:
            return self.cut
        grids = [structure.grid for structure in self.structures]
        steps = max(grid.inner_size * grid.problem.samples for grid in grids)
        most = max(grid.outer_count for grid in grids)
        return min(max(1, round(_STEPS_PER_CHUNK / steps)), most)

    @cached_property
    def _places(self) -> list[tuple[Structure, int]]:
        """Of every chunk: its structure, and the first of its outer points."""
        return [
            (structure, first)
            for structure in self.structures
            for first in range(0, structure.grid.outer_count, self.points_per_chunk)
        ]

    @property
    def chunks(self) -> list[str]:
        """Ids of the chunks, in order."""
        return [f"{i:06d}" for i in range(len(self._places))]

    def run_chunk(self, chunk: str) -> dict[str, np.ndarray]:
        """Return the rows of a chunk: configuration, scenario, the varied values, the scores."""
        structure, first = self._places[int(chunk)]
        count = min(self.points_per_chunk, structure.grid.outer_count)
        points = structure.grid.outer_points[first : first + count]
        numbers = structure.configurations[first : first + count].reshape(-1)
        # The last chunk is filled up, so that all chunks of a structure are one compiled program.
        filled = points[np.minimum(np.arange(count), len(points) - 1)]
        scores = {name: score[: len(points)] for name, score in structure.grid.evaluate(filled).items()}
        values = structure.columns_of(numbers)
        return {
            "configuration": np.repeat(numbers, self.scenarios),
            "scenario": np.tile(np.arange(self.scenarios), numbers.size),
            **{path: np.repeat(value, self.scenarios) for path, value in values.items()},
            **{name: score.reshape(-1) for name, score in scores.items()},
        }

    def study_of(self, configuration: int, place: str) -> Study:
        """Return the study of a configuration, its values to the last bit; `place` names it in errors."""
        structure = next(one for one in self.structures if configuration in one.configurations)
        values = structure.columns_of(np.array([configuration]))
        return with_numbers(structure.study, {path: float(values[path][0]) for path in structure.grid.axes}, place)

    def open(self, folder: Path, *, resume: bool) -> RunStore:
        """Return the run's store."""
        return open_run(folder, "sweep", self.study, self.plan, self.chunks, resume=resume)

    def run(self, store: RunStore, executor: Executor | None = None, *, quiet: bool = False) -> pa.Table:
        """Compute every unfinished chunk, in this process if no executor is given, and return all results."""
        label = f"sweep {self.configurations} × {self.scenarios}"
        return read_table(complete(store, executor or Inline(), label, quiet=quiet))

    def forecast(self) -> Forecast:
        """Compile and time one chunk of every structure."""
        programs = [
            [chunk for chunk, (one, _) in zip(self.chunks, self._places, strict=True) if one is structure]
            for structure in self.structures
        ]
        rows = self.configurations * self.scenarios
        return foresee(self, programs, lambda columns: 24 * len(columns) * rows)


def plan_sweep(study: Study, place: str) -> GridSweep:
    """Return the sweep that a study's `[sweep]` table asks for.

    Raises:
        InputError: the grid is empty.
    """
    if not study.sweep.grid:
        path, own = contested_number(study)
        fix = f"add one, or give --grid {path}=log({0.1 * own:g},{10.0 * own:g},8)"
        raise input_error(f"{place}: sweep.grid", "has no axis", fix)
    settings = structural_paths(study)
    axes: dict[str, Sequence[Value]] = {
        path: options_of(axis, settings[path]) if path in settings else axis.grid()
        for path, axis in study.sweep.grid.items()
    }
    return GridSweep(study, axes, study.sweep.scenarios)


def write_winner(sweep: GridSweep, best: Mapping[str, Any], path: Path) -> Path | None:
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
    study = sweep.study
    provenance = {
        "command": "sweep",
        "objective": study.tune.objective,
        "study_hash": study_hash(study),
        "seed": study.seed,
        "versions": versions(study),
        "swept": sorted(sweep.axes),
        "scenarios": sweep.scenarios,
        "train": {name: best[name] for name in ("mean", "median", "q90")},
    }
    winner = sweep.study_of(int(best["configuration"]), "best of the sweep")
    write_text(path, to_toml(descended(winner, provenance)))
    return path


def say_edges(axes: Mapping[str, Sequence[Any]], best: Mapping[str, Any]) -> list[str]:
    """Return a sentence for every axis at whose end the best configuration lies: a better one may lie beyond.

    Args:
        axes: the values by path; those of a setting that is no number have no end.
        best: the first row of a ranking.
    """
    said = []
    for path, values in axes.items():
        is_scale = len(values) > 2 and all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
        if not is_scale or math.isnan(best["mean"]) or best[path] not in (min(values), max(values)):
            continue
        end, beyond = ("largest", "larger") if best[path] == max(values) else ("smallest", "smaller")
        value = f"{best[path]:.6g}"
        said.append(f"the best lies on the grid's edge: {path} = {value} is its {end}; add {beyond} values")
    return said


def rank(table: pa.Table, axes: Sequence[str], score: str) -> list[dict[str, Any]]:
    """Return the configurations, best mean score first, with the mean, median and 90 % quantile over scenarios.

    Scores that are shown beside it follow by their names, their means.
    A configuration with scenarios whose score is not finite, counted under "diverged", has none and goes last.
    """
    values = table[score].to_numpy()
    values = np.where(np.isfinite(values), values, np.nan)
    numbers = table["configuration"].to_numpy()
    order = np.lexsort((table["scenario"].to_numpy(), numbers))
    scenarios = int(table["scenario"].to_numpy().max()) + 1
    per_configuration = values[order].reshape(-1, scenarios)
    firsts = order[::scenarios]
    shown = [name for name, one in SCORES.items() if one.is_beside and name in table.column_names]
    beside = {name: table[name].to_numpy()[order].reshape(-1, scenarios) for name in shown}
    rows = [
        {
            "configuration": int(numbers[first]),
            **{path: table[path][int(first)].as_py() for path in axes},
            "mean": float(np.mean(scores)),
            "median": float(np.median(scores)),
            "q90": float(np.quantile(scores, 0.9)),
            "diverged": int(np.sum(np.isnan(scores))),
            **{name: float(np.mean(each)) for name, each in zip(beside, others, strict=True)},
        }
        for first, scores, *others in zip(firsts, per_configuration, *beside.values(), strict=True)
    ]
    return sorted(rows, key=lambda row: (math.isnan(row["mean"]), row["mean"]))
