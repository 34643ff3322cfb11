"""The points that a search has tried."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from tuning.pictures.style import ESTIMATE, OTHER, QUIET, new_figure


def draw_tried(
    objective: np.ndarray, refined: np.ndarray, numbers: Mapping[str, np.ndarray], label: str
) -> Figure:
    """Draw the objective of every point tried over each number.

    Args:
        objective: `(point,)`; NaN where it failed.
        refined: `(point,)` which points are where a start of the gradient ended.
        numbers: `(point,)` by name; none of them is drawn as one curve in the order of trying.
        label: what the objective is.
    """
    shown: Mapping[str, np.ndarray] = numbers or {"point": np.arange(objective.size)}
    figure, axes = new_figure(3.4 * len(shown), 3.4, 1, len(shown), squeeze=False, sharey=True)
    best = int(np.nanargmin(objective))
    for axis, (name, values) in zip(axes[0], shown.items(), strict=True):
        for chosen, colour, said in ((~refined, QUIET, "tried"), (refined, ESTIMATE, "refined")):
            if chosen.any():
                axis.plot(values[chosen], objective[chosen], "o", color=colour, markersize=3.5, label=said)
        axis.plot(values[best], objective[best], "*", color=OTHER, markersize=11, label="best")
        if np.nanmin(values) > 0 and np.nanmax(values) > 10 * np.nanmin(values):
            axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_xlabel(name, fontsize=8)
    axes[0, 0].set_ylabel(label)
    axes[0, 0].legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, fontsize=8)
    return figure


def is_refined(messages: Sequence[str] | np.ndarray) -> np.ndarray:
    """Return which rows of a search's results are ends of starts, from their column `message`."""
    return np.array([message != "screened" for message in messages], dtype=bool)
