"""Pictures of searches: a grid's scores, and what tuning gained."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator

from tuning.pictures.style import ESTIMATE, OTHER, make_log, new_figure, plain
from tuning.pictures.tried import draw_tried, is_refined
from tuning.study.scores import title_of, unit_of

NEAR = 1.05
"""Factor on the best score within which a configuration counts as near the best."""
_MAP = "viridis_r"
_TICKS = 10
"""Of an axis of a heat map, so that their numbers do not run into each other."""
_DASHES = ("-", "--", "-.")
"""Of curves that have run through all colours."""


def draw_sweep(
    rows: Sequence[Mapping[str, Any]],
    axes_values: Mapping[str, Sequence[Any]],
    objective: str,
    *,
    pair: tuple[str, str] | None = None,
) -> Figure:
    """Draw the mean objective over every pair of axes, minimised over the others; over one axis, as a curve.

    Args:
        rows: the configurations with their means.
        axes_values: the axes by path; where a setting leaves a number without meaning, only its first is drawn.
        objective: what was averaged.
        pair: draw only this pair of axes.
    """
    paths = list(axes_values)
    shape = [len(axes_values[path]) for path in paths]
    means = np.full(int(np.prod(shape)), np.nan)
    for row in rows:
        means[int(row["configuration"])] = row["mean"]
    cube = means.reshape(shape)
    wide = [i for i, size in enumerate(shape) if size > 1]
    if len(wide) < 2:
        return _draw_curve(cube, paths, axes_values, wide, objective)
    pairs = [(a, b) for n, a in enumerate(wide) for b in wide[n + 1 :]]
    if pair is not None:
        pairs = [(paths.index(pair[0]), paths.index(pair[1]))]
    figure, axes = new_figure(4.3 * len(pairs), 3.7, 1, len(pairs), squeeze=False)
    finite = cube[np.isfinite(cube)] if np.isfinite(cube).any() else np.ones(1)
    norm = LogNorm(finite.min(), max(np.quantile(finite, 0.95), 1.001 * finite.min()))
    for axis, (a, b) in zip(axes[0], pairs, strict=True):
        others = tuple(i for i in range(len(paths)) if i not in (a, b))
        # `fmin` passes over diverged configurations, and leaves a blank where there is nothing else.
        plane = np.fmin.reduce(cube, axis=others) if others else cube
        x, y = axes_values[paths[b]], axes_values[paths[a]]
        axis.pcolormesh(np.arange(len(x) + 1), np.arange(len(y) + 1), plane, norm=norm, cmap=_MAP)
        if np.isfinite(plane).any():
            best = np.unravel_index(np.nanargmin(plane), plane.shape)
            axis.plot(best[1] + 0.5, best[0] + 0.5, "*", color="white", markersize=11, markeredgecolor="black")
            _outline(axis, plane <= NEAR * np.nanmin(plane))
        for values, set_ticks, turn in ((x, axis.set_xticks, 60), (y, axis.set_yticks, 0)):
            shown = np.linspace(0, len(values) - 1, min(len(values), _TICKS)).round().astype(int)
            set_ticks(shown + 0.5, [_tick(values[i]) for i in shown], rotation=turn, fontsize=8)
        axis.set_xlabel(paths[b])
        axis.set_ylabel(paths[a])
        axis.grid(visible=False)
    bar = figure.colorbar(ScalarMappable(norm, _MAP), ax=axes[0].tolist(), extend="max")
    # Nine numbers a decade would run into each other.
    bar.ax.yaxis.set_minor_locator(LogLocator(subs=(2, 3, 5)))
    bar.ax.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    bar.ax.yaxis.set_minor_formatter(FormatStrFormatter("%g"))
    bar.set_label(f"mean {title_of(objective)},\nbest over other axes")
    figure.suptitle(f"Star: best configuration; outline: within {100 * (NEAR - 1):.0f} % of it")
    return figure


def _tick(value: Any) -> str:
    return f"{float(f'{value:.3g}'):g}" if isinstance(value, float) else plain(str(value))


def _outline(axis: Axes, inside: np.ndarray) -> None:
    """Outline cells of a heat map whose cells are of size 1."""
    framed = np.pad(inside, 1)
    # An edge lies wherever a cell and the one before it are not both inside or both outside.
    across = [((x, y), (x, y + 1)) for y, x in np.argwhere(framed[1:-1, 1:] != framed[1:-1, :-1])]
    along = [((x, y), (x + 1, y)) for y, x in np.argwhere(framed[1:, 1:-1] != framed[:-1, 1:-1])]
    for colour, width in (("white", 3.2), ("black", 1.4)):
        axis.add_collection(LineCollection([*across, *along], colors=colour, linewidths=width, capstyle="round"))


def _draw_curve(
    cube: np.ndarray,
    paths: Sequence[str],
    values: Mapping[str, Sequence[Any]],
    wide: Sequence[int],
    objective: str,
) -> Figure:
    path = paths[wide[0] if wide else 0]
    figure, axis = new_figure(5.5, 3.6)
    if all(isinstance(value, float) for value in values[path]):
        axis.plot(values[path], cube.reshape(-1), "o-", color=ESTIMATE)
        make_log(axis, "x", np.asarray(values[path]))
    else:
        # Settings have no distances: one place each, and no line between them.
        axis.plot(np.arange(len(values[path])), cube.reshape(-1), "o", color=ESTIMATE)
        axis.set_xticks(np.arange(len(values[path])), [_tick(value) for value in values[path]])
    make_log(axis, "y", cube)
    axis.set_xlabel(path)
    axis.set_ylabel(f"mean {title_of(objective)}")
    figure.suptitle("Sweep")
    return figure


def draw_search(
    each: Mapping[str, np.ndarray], columns: Mapping[str, np.ndarray], paths: Sequence[str], objective: str
) -> Figure:
    """Draw what a search has gained over held-out scenarios; where there is one alone, the points that it tried.

    Args:
        each: held-out objectives by configuration.
        columns: of its results.
        paths: the tuned numbers.
        objective: what was minimised.
    """
    if all(values.size > 1 for values in each.values()):
        return draw_tuning(each, objective)
    refined = is_refined(columns.get("message", ["screened"] * columns["objective"].size))
    numbers = {path.removeprefix("estimator."): columns[path] for path in paths}
    return draw_tried(columns["objective"], refined, numbers, f"training: {title_of(objective)}")


def draw_tuning(each: Mapping[str, np.ndarray], objective: str) -> Figure:
    """Draw how an objective is distributed over held-out scenarios, one curve a configuration."""
    if all(values.size == 1 for values in each.values()):
        return draw_each(each, objective)
    unit = unit_of(objective)
    figure, axis = new_figure(6.4, 3.8)
    colours = [OTHER, ESTIMATE, "#009e73", "#cc79a7", "#e69f00", "#56b4e9"]
    for i, (label, values) in enumerate(each.items()):
        colour, dashes = colours[i % len(colours)], _DASHES[i // len(colours) % len(_DASHES)]
        finite = np.sort(values[np.isfinite(values)])
        if not finite.size:
            axis.plot([], [], dashes, color=colour, label=f"{plain(label)}: every scenario diverged")
            continue
        share = (np.arange(finite.size) + 1) / finite.size
        axis.step(
            finite,
            100 * share,
            where="post",
            color=colour,
            linestyle=dashes,
            label=f"{plain(label)}: mean {finite.mean():.3g}{unit}",
        )
        axis.axvline(finite.mean(), color=colour, linestyle=":", linewidth=1)
    axis.set_xscale("log")
    low, high = axis.get_xlim()
    if high < 30 * low:
        # Less than a decade and a half: the minor ticks carry the numbers.
        axis.xaxis.set_minor_formatter(FormatStrFormatter("%g"))
        axis.tick_params(axis="x", which="both", labelsize=7)
    axis.xaxis.set_major_formatter(FormatStrFormatter("%g"))
    axis.set_xlabel(title_of(objective))
    axis.set_ylabel("share of held-out\nscenarios below [%]")
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, fontsize=8)
    return figure


def draw_each(each: Mapping[str, np.ndarray], metric: str) -> Figure:
    """Draw the score of every configuration in the one scenario that there is, a line each."""
    figure, axis = new_figure(6.4, 1.2 + 0.35 * len(each))
    values = np.array([value[0] for value in each.values()])
    axis.plot(values, np.arange(values.size), "o", color=ESTIMATE)
    axis.set_yticks(np.arange(values.size), [plain(label) for label in each])
    axis.set_ylim(values.size - 0.5, -0.5)
    make_log(axis, "x", values)
    axis.set_xlabel(title_of(metric))
    return figure
