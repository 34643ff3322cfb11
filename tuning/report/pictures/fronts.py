"""The picture of a Pareto front."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from tuning.pictures.style import ESTIMATE, QUIET, make_log, new_figure
from tuning.search.blackbox import Trial
from tuning.study.scores import unit_of


def draw_front(trials: Sequence[Trial], front: Sequence[Trial], objective: str) -> Figure:
    """Draw accuracy against convergence time on the training scenarios: every scored trial, and the front."""
    figure, axis = new_figure(6.4, 4.0)
    shown = [trial for trial in trials if trial.is_scored]
    axis.plot(
        [t.convergence_time for t in shown],
        [t.objective for t in shown],
        ".",
        color=QUIET,
        label=f"{len(shown)} trials",
    )
    axis.step(
        [t.convergence_time for t in front],
        [t.objective for t in front],
        "o-",
        where="pre",
        color=ESTIMATE,
        label=f"front of {len(front)}",
    )
    make_log(axis, "x", np.array([t.convergence_time for t in shown]))
    make_log(axis, "y", np.array([t.objective for t in shown]))
    axis.set_xlabel("median convergence time [s]; never converged: the recording's duration")
    axis.set_ylabel(
        f"{objective} on training scenarios" + (f" [{unit}]" if (unit := unit_of(objective).strip()) else "")
    )
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, fontsize=8)
    return figure
