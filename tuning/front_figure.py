"""The picture of a Pareto front."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from tuning.blackbox import Trial
from tuning.figures import ESTIMATE, QUIET, new_figure


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
    axis.set_yscale("log")
    axis.set_xlabel("median convergence time [s]; never converged: the recording's duration")
    axis.set_ylabel(f"{objective} on training scenarios [%]")
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, fontsize=8)
    return figure
