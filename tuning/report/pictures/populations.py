"""Pictures of a Monte Carlo run: how scores are spread, what moves them, and how the estimates look over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import NullFormatter

from tuning.pictures.style import ESTIMATE, OTHER, QUIET, TRUTH, new_figure, plain, save
from tuning.problem.interface import Status
from tuning.scoring.summary import Summary
from tuning.study.base import Study
from tuning.study.scores import time_of, title_of

Rows = Mapping[str, np.ndarray]


def draw_population(folder: Path, study: Study, summary: Summary) -> list[Path]:
    """Draw the pictures of a finished run into its folder."""
    objective, paths = study.tune.objective, study.population.paths
    columns = list(dict.fromkeys(["status", *_spread(study), *paths]))
    table = pq.read_table(folder / "results.parquet", columns=columns)
    counted = table["status"].to_numpy() == Status.OK
    rows = {name: table[name].to_numpy()[counted] for name in columns}
    drawn = {"spread": draw_spread(rows, study, summary)}
    if paths:
        drawn["numbers"] = draw_numbers(rows, paths, objective)
    if summary.influences:
        drawn["influences"] = draw_influences(summary, objective)
    return [save(figure, folder / "figures" / f"{name}.png") for name, figure in drawn.items()]


def _spread(study: Study) -> list[str]:
    """Return the scores whose distribution is drawn: the objective, and the time where there is one."""
    time = time_of(study.tune.objective)
    return list(dict.fromkeys([study.tune.objective, *([] if time is None else [time])]))


def draw_spread(rows: Rows, study: Study, summary: Summary, *, across: int = 2) -> Figure:
    """Draw how the objective and the convergence time are distributed, with the quantiles' intervals."""
    metrics = _spread(study)
    size = (
        (4.5 * len(metrics), 3.8, 1, len(metrics)) if across == 2 else (5.6, 2.8 * len(metrics), len(metrics), 1)
    )
    figure, grid = new_figure(*size, sharey=True, squeeze=False)
    axes = list(grid.flat)
    for axis, metric in zip(axes, metrics, strict=True):
        values = np.sort(rows[metric][~np.isnan(rows[metric])])
        share = 100 * (np.arange(values.size) + 1) / max(values.size, 1)
        finite = np.isfinite(values)
        # A million points are no sharper than a thousand.
        shown = np.unique(np.linspace(0, max(finite.sum() - 1, 0), 1000).astype(int)) if finite.any() else []
        axis.step(values[shown], share[shown], where="post", color=ESTIMATE)
        for level, q in summary.quantiles[metric].items():
            if np.isfinite([q.low, q.high]).all():
                axis.plot([q.low, q.high], [100 * level] * 2, color=OTHER, linewidth=4, alpha=0.6)
        if finite.any() and values[finite].min() > 0:
            axis.set_xscale("log")
        axis.set_xlabel(title_of(metric))
    for axis in axes[:1] if across == 2 else axes:
        axis.set_ylabel("share of the robots below [%]")
    figure.suptitle(f"{summary.scenarios} robots: {plain(study.name)} (bars: 95 % intervals of quantiles)")
    return figure


def draw_numbers(rows: Rows, paths: Sequence[str], objective: str, *, across: int = 3) -> Figure:
    """Draw the objective against each number that varies, with its median and 90 % band."""
    across = min(across, len(paths))
    down = -(-len(paths) // across)
    figure, axes = new_figure(3.6 * across, 2.7 * down, down, across, squeeze=False, sharey=True)
    usable = np.isfinite(rows[objective]) & (rows[objective] > 0)
    for axis, path in zip(axes.flat, paths, strict=False):
        _draw_band(axis, rows[path][usable], rows[objective][usable])
        if usable.any():
            axis.set_yscale("log")
            _scale(axis, rows[path][usable])
        axis.set_xlabel(path, fontsize=8)
    for axis in axes.flat[len(paths) :]:
        axis.set_visible(False)
    for axis in axes[:, 0]:
        axis.set_ylabel(title_of(objective), fontsize=8)
    figure.suptitle("Score against each number: median and 90 % of the scenarios")
    return figure


def _scale(axis: Axes, numbers: np.ndarray) -> None:
    """Make the x axis logarithmic where its numbers span a decade, with ticks that stay apart."""
    is_wide = numbers.size and numbers.min() > 0 and numbers.max() > 10 * numbers.min()
    if is_wide:
        axis.set_xscale("log")
        axis.xaxis.set_minor_formatter(NullFormatter())
    levels = np.unique(numbers)
    if levels.size <= 4:
        axis.set_xticks(levels, [f"{level:g}" for level in levels])
    elif not is_wide:
        axis.locator_params(axis="x", nbins=5)


def _draw_band(axis: Axes, x: np.ndarray, y: np.ndarray) -> None:
    if x.size < 20:
        axis.plot(x, y, "o", color=ESTIMATE, markersize=3)
        return
    levels = np.unique(x)
    if levels.size <= 10:
        groups = [y[x == level] for level in levels]
        centres = levels
    else:
        edges = np.quantile(x, np.linspace(0, 1, min(25, x.size // 20 + 2)))
        places = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, edges.size - 2)
        groups = [y[places == i] for i in range(edges.size - 1)]
        centres = np.array([x[places == i].mean() for i in range(edges.size - 1)])
    low, middle, high = (np.array([np.quantile(group, level) for group in groups]) for level in (0.05, 0.5, 0.95))
    style = "o-" if levels.size <= 10 else "-"
    axis.fill_between(centres, low, high, color=ESTIMATE, alpha=0.2, linewidth=0)
    axis.plot(centres, middle, style, color=ESTIMATE)


def draw_influences(summary: Summary, objective: str) -> Figure:
    """Draw the Sobol indices with their intervals, largest first."""
    ranked = sorted(summary.influences.items(), key=lambda item: item[1].total.value)
    figure, axis = new_figure(7.5, 1.4 + 0.42 * len(ranked))
    for place, (_, influence) in enumerate(ranked):
        for index, colour, offset in ((influence.total, QUIET, 0.15), (influence.first, ESTIMATE, -0.15)):
            axis.barh(place + offset, 100 * index.value, height=0.28, color=colour)
            axis.plot([100 * index.low, 100 * index.high], [place + offset] * 2, color=TRUTH, linewidth=1)
    patches = [Patch(color=ESTIMATE, label="by itself"), Patch(color=QUIET, label="with interactions")]
    axis.set_yticks(range(len(ranked)), [name for name, _ in ranked], fontsize=8)
    axis.set_xlabel(f"share of the variance of log10 {objective} [%]")
    axis.legend(handles=patches, loc="lower right", fontsize=8)
    figure.suptitle("What moves the score (lines: 95 % intervals)")
    return figure
