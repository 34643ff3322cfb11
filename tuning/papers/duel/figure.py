"""The duel's picture: error against noise for both families, as given and tuned."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tuning.papers.duel import cells as duel
from tuning.pictures.style import ESTIMATE, OTHER, new_figure, save

_STYLES = (
    (duel.PRINTED, ESTIMATE, ":", "algebraic, as printed"),
    (duel.UNFILTERED, ESTIMATE, "--", "algebraic, tuned, unfiltered"),
    (duel.ALGEBRAIC, ESTIMATE, "-", "algebraic, tuned"),
    (duel.GIVEN, OTHER, ":", "residual, as given"),
    (None, OTHER, "-", "residual, tuned (better basis)"),
)


def draw(cells: Sequence[duel.Cell], folder: Path) -> Path:
    """Draw one panel an excitation into `folder`."""
    names = list(dict.fromkeys(cell.setting for cell in cells))
    figure, axes = new_figure(10.0, 4.2, 1, len(names), sharey=True)
    for axis, name in zip(axes, names, strict=True):
        own = [cell for cell in cells if cell.setting == name]
        levels = 1e3 * np.array([cell.level for cell in own])
        for contender, colour, line, label in _STYLES:
            scores = np.array([cell.mse[contender or cell.residual] for cell in own])
            axis.plot(levels, scores[:, 0], line, marker="o", markersize=3.5, color=colour, label=label)
            axis.fill_between(levels, scores[:, 1], scores[:, 2], color=colour, alpha=0.25, linewidth=0)
        axis.set(xscale="log", yscale="log", xlabel="encoder noise [mrad]", title=name)
    axes[0].set_ylabel("held-out MSE [(N·m/rad)²]")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=8)
    return save(figure, folder / "duel.png")
