"""The pictures of a report that no command draws by itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter

from tuning.pictures.style import ESTIMATE, OTHER, QUIET, TRUTH, WIDTH, make_log, new_figure, plain
from tuning.report.pictures.populations import Rows
from tuning.report.pictures.searches import NEAR
from tuning.study.scores import title_of

_MAP = "viridis_r"


def draw_shares(groups: Mapping[str, np.ndarray], metric: str) -> Figure:
    """Draw how a metric is distributed in groups of scenarios, one curve a group."""
    figure, axis = new_figure(WIDTH, 3.9)
    colours = [TRUTH, ESTIMATE, OTHER, "#009e73", "#cc79a7", "#e69f00", "#56b4e9"]
    is_positive = True
    for i, (label, values) in enumerate(groups.items()):
        finite = np.sort(values[np.isfinite(values)])
        text = f"{plain(label)} ({values.size})"
        colour, style = colours[i % len(colours)], ("-", "--", ":")[i // len(colours) % 3]
        if not finite.size:
            axis.plot([], [], style, color=colour, label=f"{text}: no score")
            continue
        is_positive &= bool(finite[0] > 0)
        # A million points are no sharper than a thousand.
        places = np.unique(np.linspace(0, finite.size - 1, 600).astype(int))
        # Scenarios that never reach a finite value keep the curve below 100 %.
        share = 100 * (places + 1) / values.size
        axis.step(finite[places], share, style, where="post", color=colour, label=text)
    if is_positive:
        axis.set_xscale("log")
        _name_ticks(axis)
    axis.set_xlabel(title_of(metric))
    axis.set_ylabel("share of the scenarios below [%]")
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=1 if len(groups) < 4 else 2, fontsize=8)
    return figure


def _name_ticks(axis: Axes) -> None:
    """Number the minor ticks of a logarithmic x axis where there are few major ones."""
    low, high = axis.get_xlim()
    if high < 30 * low:
        axis.xaxis.set_minor_formatter(FormatStrFormatter("%g"))
        axis.tick_params(axis="x", which="minor", labelsize=7, labelrotation=45)
        axis.xaxis.set_major_formatter(FormatStrFormatter("%g"))


def front(cost: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the indices of the Pareto front of two costs, by the first; only finite points are on it."""
    order = np.lexsort((other, cost))
    best, found = np.inf, []
    for i in order:
        if np.isfinite(cost[i]) and other[i] < best:
            best = other[i]
            found.append(i)
    return np.array(found, int)


def draw_front(accuracy: np.ndarray, time: np.ndarray, label: str) -> Figure:
    """Draw configurations by accuracy and convergence time, with their Pareto front."""
    figure, axis = new_figure(WIDTH, 4.2)
    finite = np.isfinite(accuracy) & np.isfinite(time)
    chosen = front(accuracy, time)
    axis.plot(
        time[finite], accuracy[finite], "o", color=QUIET, markersize=3.5, rasterized=True, label="configurations"
    )
    axis.plot(time[chosen], accuracy[chosen], "o", color=ESTIMATE, markersize=5, label="Pareto front")
    axis.step(time[chosen], accuracy[chosen], where="pre", color=ESTIMATE)
    make_log(axis, "x", time[finite])
    make_log(axis, "y", accuracy[finite])
    axis.set_xlabel("median convergence time [s]")
    axis.set_ylabel(label)
    axis.legend(loc="upper right", fontsize=8)
    return figure


def draw_parallel(rows: Sequence[Mapping[str, float]], paths: Sequence[str], score: str, label: str) -> Figure:
    """Draw configurations, best first, as lines across their numbers, each on its own scale; the best is thick."""
    names = short_paths(paths)
    scores = np.array([row[score] for row in rows], float)
    finite = scores[np.isfinite(scores)]
    norm = _norm(finite)
    bars = [_Bar(np.array([row[path] for row in rows], float)) for path in paths]
    places = np.stack([bar.place for bar in bars], axis=1)
    figure, axis = new_figure(max(WIDTH, 1.25 * len(paths) + 1.4), 4.4)
    for i in reversed(range(len(rows))):
        # Equal numbers would hide one another: later lines lie a little lower.
        line = places[i] - 0.004 * min(i, 10)
        colour = ScalarMappable(norm, _MAP).to_rgba(scores[i]) if np.isfinite(scores[i]) else QUIET
        axis.plot(
            range(len(paths)), line, color=colour, linewidth=3.2 if i == 0 else 1.1, marker="o", markersize=3
        )
    for i, bar in enumerate(bars):
        axis.plot([i, i], [-0.05, 1.02], color=TRUTH, linewidth=0.8, zorder=1)
        for place, text in ((-0.09, bar.low), (1.06, bar.high)):
            axis.text(i, place, f"{text:.3g}", ha="center", va="center", fontsize=8)
    axis.set_ylim(-0.14, 1.1)
    axis.set_xlim(-0.3, len(paths) - 0.7)
    axis.set_xticks(range(len(paths)), [name.replace(".", ".\n") for name in names], fontsize=8)
    axis.set_yticks([])
    axis.grid(visible=False)
    axis.spines["left"].set_visible(False)
    bar = figure.colorbar(ScalarMappable(norm, _MAP), ax=axis)
    bar.ax.yaxis.set_minor_formatter(FormatStrFormatter("%g"))
    bar.ax.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    bar.ax.tick_params(which="minor", labelsize=7)
    bar.set_label(label)
    return figure


class _Bar:
    """A number's own scale in parallel coordinates."""

    def __init__(self, values: np.ndarray):
        self.low, self.high = float(values.min()), float(values.max())
        is_wide = self.low > 0 and self.high > 10 * self.low
        scaled = np.log(values) if is_wide else values
        span = np.ptp(scaled)
        self.place = (scaled - scaled.min()) / span if span > 0 else np.full(values.shape, 0.5)


def _norm(finite: np.ndarray) -> Normalize:
    if not finite.size:
        return Normalize(0.0, 1.0)
    low, high = float(finite.min()), float(finite.max())
    if low > 0 and high > 2 * low:
        return LogNorm(low, high)
    return Normalize(low, high if high > low else low + max(abs(low), 1.0) * 1e-3)


def draw_points(x: np.ndarray, y: np.ndarray, score: np.ndarray, paths: tuple[str, str], label: str) -> Figure:
    """Draw tried points in a plane of two numbers, coloured by score, those near the best ringed."""
    figure, axis = new_figure(WIDTH, 4.2)
    finite = np.isfinite(score)
    # The best lie on top.
    order = np.flatnonzero(finite)[np.argsort(-score[finite])]
    low = score[finite].min() if finite.any() else np.nan
    near = order[score[order] <= NEAR * low]
    values = score[finite]
    norm = _norm(values[values <= np.quantile(values, 0.95)] if values.size else values)
    axis.plot(x[~finite], y[~finite], "x", color=QUIET, markersize=5)
    axis.scatter(
        x[order], y[order], c=score[order], norm=norm, cmap=_MAP, s=42, edgecolors="white", linewidths=0.4
    )
    axis.scatter(x[near], y[near], s=110, facecolors="none", edgecolors=OTHER, linewidths=1.6)
    if order.size:
        axis.plot(x[order[-1]], y[order[-1]], "*", color="white", markersize=12, markeredgecolor="black")
    for values, scale in ((x, axis.set_xscale), (y, axis.set_yscale)):
        if values.min() > 0 and values.max() > 10 * values.min():
            scale("log")
    axis.set_xlabel(paths[0])
    axis.set_ylabel(paths[1])
    bar = figure.colorbar(ScalarMappable(norm, _MAP), ax=axis, extend="max")
    bar.ax.yaxis.set_minor_formatter(FormatStrFormatter("%g"))
    bar.ax.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    bar.ax.tick_params(which="minor", labelsize=7)
    bar.set_label(label)
    return figure


def draw_pairs(first: np.ndarray, second: np.ndarray, names: tuple[str, str], metric: str) -> Figure:
    """Draw one run's score against the other's, a point a scenario."""
    figure, axis = new_figure(WIDTH, 4.4)
    usable = np.isfinite(first) & np.isfinite(second)
    shown = np.flatnonzero(usable)[:4000]
    axis.plot(first[shown], second[shown], "o", color=ESTIMATE, markersize=3, alpha=0.5, rasterized=True)
    if shown.size:
        both = np.concatenate([first[shown], second[shown]])
        if both.min() > 0:
            axis.set_xscale("log")
            axis.set_yscale("log")
            _name_ticks(axis)
        ends = [both.min(), both.max()]
        axis.plot(ends, ends, "--", color=TRUTH, label="the same in both")
        axis.legend(loc="upper left", fontsize=8)
    axis.set_xlabel(f"{plain(names[0])}: {title_of(metric)}")
    axis.set_ylabel(f"{plain(names[1])}: {title_of(metric)}")
    return figure


def short_paths(paths: Sequence[str]) -> list[str]:
    """Return the last two parts of each path, or as many as tell it from the others."""
    found = []
    for path in paths:
        parts = path.split(".")
        size = 2
        while (
            size < len(parts) and sum(f".{other}".endswith("." + ".".join(parts[-size:])) for other in paths) > 1
        ):
            size += 1
        found.append(".".join(parts[-size:]))
    return found


def _ends_with(path: str, parts: Sequence[str]) -> bool:
    return path.split(".")[-len(parts) :] == list(parts)


def short_rows(rows: Rows, paths: Sequence[str]) -> tuple[dict[str, np.ndarray], list[str]]:
    """Return columns with short names in the place of paths, and these names."""
    names = short_paths(paths)
    return {**rows, **{name: rows[path] for name, path in zip(names, paths, strict=True)}}, names
