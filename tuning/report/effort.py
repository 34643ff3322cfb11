"""What a search cost: scored configurations and seconds, and how many of each it took to reach a score."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from tuning.pictures.page import Picture, Table, number
from tuning.pictures.style import new_figure
from tuning.report.gather import FinishedRun
from tuning.study.scores import title_of

_REACHED = 1.01
"""Of the score that all searches reach, what counts as reached."""


@dataclass(frozen=True)
class Effort:
    """How a search's best score fell.

    Args:
        evaluations: `(row,)` configurations scored until then; a step of an optimiser is one.
        seconds: `(row,)` that they took, compilation included [s].
        best: `(row,)` best training objective until then; infinite before the first.
    """

    evaluations: np.ndarray
    seconds: np.ndarray
    best: np.ndarray

    def reach(self, score: float) -> tuple[int, float] | None:
        """Return evaluations and seconds until a score is reached, or `None`."""
        reached = np.flatnonzero(self.best <= score)
        return (int(self.evaluations[reached[0]]), float(self.seconds[reached[0]])) if reached.size else None


def effort_of(run: FinishedRun) -> Effort:
    """Return what a `tune` run cost, row by row of its results."""
    columns = run.columns
    objective = np.where(np.isfinite(columns["objective"]), columns["objective"], np.inf)
    steps = np.maximum(columns.get("steps", np.zeros(objective.size)), 1)
    return Effort(np.cumsum(steps).astype(int), np.cumsum(columns["seconds"]), np.minimum.accumulate(objective))


def show_effort(runs: Mapping[str, FinishedRun]) -> Iterator[Picture]:
    """Yield the best score so far of one or more `tune` runs, over evaluations and over time."""
    efforts = {name: effort for name, run in runs.items() if np.isfinite((effort := effort_of(run)).best).any()}
    if not efforts:
        return
    label = f"best so far in training:\n{title_of(next(iter(runs.values())).objective)}"
    said = [
        f"{name or 'the search'} ends at {number(float(e.best[-1]))} after {e.evaluations[-1]} evaluations"
        for name, e in efforts.items()
    ]
    caption = "Best so far. A step of an optimiser counts as one evaluation, and a start is drawn where it ends."
    yield Picture("What the search cost", _draw(efforts, label), caption, "; ".join(said) + ".")


def tabulate_effort(runs: Mapping[str, FinishedRun]) -> Table:
    """Return the evaluations and the time that each `tune` run took to the score that all of them reach."""
    efforts = {name: effort_of(run) for name, run in runs.items()}
    score = _REACHED * max(float(e.best[-1]) for e in efforts.values())
    rows = []
    for name, e in efforts.items():
        evaluations, seconds = e.reach(score) or ("", "")
        rows.append([name, float(e.best[-1]), int(e.evaluations[-1]), float(e.seconds[-1]), evaluations, seconds])
    to = f"to {number(score)}"
    headers = ["run", "best training objective", "evaluations", "time [s]", f"evaluations {to}", f"time {to} [s]"]
    share = 100 * (_REACHED - 1)
    note = f"{number(score)} lies {share:.0f} % above the worst of the best scores. Times include compilation."
    return Table("What the searches cost", headers, rows, note)


def _draw(efforts: Mapping[str, Effort], label: str) -> Figure:
    figure, (left, right) = new_figure(5.6, 3.2, 1, 2, sharey=True)
    for name, effort in efforts.items():
        for axis, cost in ((left, effort.evaluations), (right, effort.seconds)):
            axis.step(cost, np.where(np.isfinite(effort.best), effort.best, np.nan), where="post", label=name)
            axis.plot(cost[-1], effort.best[-1], "o", color=axis.lines[-1].get_color(), markersize=4)
    left.set_xlabel("evaluations")
    right.set_xlabel("time [s]")
    left.set_ylabel(label)
    if any(efforts):
        right.legend(loc="upper right", fontsize=8)
    return figure
