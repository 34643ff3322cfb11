"""Pictures, all in one style; every function returns a figure, and `save` writes it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator, MaxNLocator, NullFormatter

from tuning.kinds.log.answer import Answer
from tuning.logs.reading import RecordingTable
from tuning.scoring.intervals import unit_of

TRUTH, ESTIMATE, OTHER, QUIET = "#222222", "#0072b2", "#d55e00", "#bbbbbb"
NEAR = 1.05
"""Factor on the best score within which a configuration counts as near the best."""
_MAP = "viridis_r"
_TICKS = 10
"""Of an axis of a heat map, so that their numbers do not run into each other."""
_DASHES = ("-", "--", "-.")
"""Of curves that have run through all colours."""
mpl.rcParams.update(
    {
        "font.size": 9.5,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.grid": True,
        "grid.color": "#e6e6e6",
        "axes.axisbelow": True,
        "legend.frameon": False,
        "lines.linewidth": 1.3,
        "savefig.dpi": 130,
    }
)
SWING_UNITS = {
    "settling_time": "settling time [s]",
    "log_energy": "mean log-energy",
    "decay_rate": "decay rate [1/s]",
    "residual": "residual swing [rad]",
    "peak": "largest swing [rad]",
    "switches": "switches a second [1/s]",
    "travel": "way of the stiffness [ranges/s]",
}
_OBJECTIVES = {"msrep": "MSREP [%]", "msrep_settled": "MSREP after the warm-up [%]"} | SWING_UNITS
_LABELS = {
    "link_position": "link\nposition [rad]",
    "motor_position": "motor\nposition [rad]",
    "setpoint_position": "set-point\nposition [rad]",
    "motor_torque": "motor\ntorque [N·m]",
    "elastic_torque": "elastic\ntorque [N·m]",
    "deflection": "deflection\n[mrad]",
    "true_stiffness": "true stiffness\n[N·m/rad]",
}


def new_figure(width: float, height: float, rows: int = 1, columns: int = 1, **options: Any) -> tuple[Figure, Any]:
    """Return a figure of `rows` × `columns` axes in the house style, size in inches."""
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(rows, columns, **options)


def make_log(axis: Axes, side: Literal["x", "y"], values: np.ndarray) -> None:
    """Make an axis of positive values logarithmic, with ticks that name numbers and leave room between.

    Args:
        axis: of a drawing.
        side: which of its two.
        values: what it shows; nothing is done unless all that are finite are positive.
    """
    values = values[np.isfinite(values)]
    if not values.size or not values.min() > 0.0:
        return
    axis.set_xscale("log") if side == "x" else axis.set_yscale("log")
    own = axis.xaxis if side == "x" else axis.yaxis
    low, high = float(values.min()), float(values.max())
    if high < 5.0 * low:
        # Too few of 1, 2 and 5 lie within: round numbers, evenly spaced.
        own.set_major_locator(MaxNLocator(4))
    else:
        own.set_major_locator(LogLocator(subs=(1.0,) if high > 1e3 * low else (1.0, 2.0, 5.0), numticks=8))
    own.set_major_formatter(FormatStrFormatter("%g"))
    own.set_minor_formatter(NullFormatter())


def thin(places: np.ndarray, most: int) -> np.ndarray:
    """Return about `most` of the places, evenly spread, the last of them kept."""
    stride = max(1, len(places) // most)
    return places if stride == 1 else np.append(places[:-1:stride], places[-1:])


def plain(text: str) -> str:
    """Return text that is drawn as it is: no mathematics between dollar signs."""
    return text.replace("$", r"\$")


def save(figure: Figure, path: Path) -> Path:
    """Write a figure and return its path."""
    from tuning.files.errors import input_error

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path)
    except OSError as error:
        raise input_error(path, f"cannot be written ({error.strerror})", "check the folder and the disk") from None
    return path


def draw_recording(columns: Mapping[str, np.ndarray], *, title: str) -> Figure:
    """Draw every signal of a recording over time."""
    shown = {}
    if {"link_position", "motor_position"} <= columns.keys():
        shown["deflection"] = 1e3 * (columns["link_position"] - columns["motor_position"])
    elif "deflection" in columns:
        shown["deflection"] = 1e3 * columns["deflection"]
    shown |= {name: columns[name] for name in _LABELS if name in columns and name not in shown}
    figure, axes = new_figure(8, 1.15 * len(shown) + 0.6, len(shown), squeeze=False, sharex=True)
    for axis, (name, values) in zip(axes[:, 0], shown.items(), strict=True):
        colour = TRUTH if name.startswith("true") else ESTIMATE
        axis.plot(columns["time"], values, color=colour, linewidth=0.8)
        axis.set_ylabel(_LABELS[name], fontsize=8)
    figure.align_ylabels()
    axes[-1, 0].set_xlabel("time [s]")
    figure.suptitle(f"Recording: {plain(title)}")
    return figure


def draw_swing(columns: Mapping[str, np.ndarray], *, title: str) -> Figure:
    """Draw a closed loop over time: where the link and its motor are, and the stiffness."""
    time = columns["time"]
    figure, axes = new_figure(8, 4.6, 2, sharex=True, height_ratios=(2, 1))
    axes[0].plot(time, columns["link_position"], color=TRUTH, label="link")
    if np.ptp(columns["motor_position"]) > 0:
        axes[0].plot(time, columns["motor_position"], color=OTHER, label="motor")
    axes[1].plot(time, columns["commanded_stiffness"], color=QUIET, linewidth=1.0, label="commanded")
    axes[1].plot(time, columns["true_stiffness"], color=ESTIMATE, label="of the spring")
    for axis, label in zip(axes, ("position [rad]", "stiffness\n[N·m/rad]"), strict=True):
        axis.set_ylabel(label)
        axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)
    figure.align_ylabels()
    axes[1].set_xlabel("time after the impact [s]")
    figure.suptitle(f"Closed loop: {plain(title)}")
    return figure


def draw_estimate(answer: Answer, table: RecordingTable, *, title: str) -> Figure:
    """Draw an estimate over time: stiffness ± 2 std of the fit, grey where not known; torque and deflection."""
    # A million points are no sharper than some thousand, and take seconds.
    shown = thin(np.arange(len(answer.columns["time"])), 40_000)
    columns = {name: values[shown] for name, values in answer.columns.items()}
    truth = {name: values[shown] for name, values in table.columns.items() if name.startswith("true_")}
    time = columns["time"]
    figure, axes = new_figure(8, 6.2, 3, sharex=True, height_ratios=(2, 1, 1))
    _draw_stiffness(axes[0], columns, truth.get("true_stiffness"))
    axes[1].plot(time, columns["torque"], color=QUIET, linewidth=0.7, label="into the fit")
    axes[1].plot(time, columns["elastic_torque"], color=ESTIMATE, label="fitted")
    if "true_elastic_torque" in truth:
        axes[1].plot(time, truth["true_elastic_torque"], "--", color=TRUTH, label="true")
    axes[1].set_ylabel("elastic torque\n[N·m]")
    axes[1].legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)
    axes[2].plot(time, 1e3 * columns["deflection"], color=OTHER, linewidth=0.8)
    axes[2].set_ylabel("deflection\n[mrad]")
    axes[2].set_xlabel("time [s]")
    figure.align_ylabels()
    figure.suptitle(f"Stiffness estimate: {plain(title)}")
    return figure


def _draw_stiffness(axis: Axes, columns: Mapping[str, np.ndarray], truth: np.ndarray | None) -> None:
    time, stiffness, known = columns["time"], columns["stiffness"], columns["known"]
    band = 2.0 * columns["stiffness_std"]
    shown = np.where(known, stiffness, np.nan)
    axis.fill_between(
        time, shown - band, shown + band, color=ESTIMATE, alpha=0.25, linewidth=0, label="± 2 std of the fit"
    )
    axis.plot(time, shown, color=ESTIMATE, label="estimate")
    pieces = [shown[known]] if known.any() else [stiffness[np.isfinite(stiffness)]]
    if truth is not None:
        axis.plot(time, truth, "--", color=TRUTH, label="true")
        pieces.append(truth)
    together = np.concatenate(pieces)
    if together.size:
        # The start-up transient may be orders of magnitude away; the view holds the bulk of what is known.
        low, high = np.quantile(together, [0.005, 0.995])
        room = 0.12 * (high - low) + 0.02 * max(abs(low), abs(high)) or 1.0
        axis.set_ylim(low - room, high + room)
    axis.fill_between(
        time,
        0,
        1,
        where=~known,
        transform=axis.get_xaxis_transform(),
        color="#eeeeee",
        step="mid",
        label="not known",
    )
    axis.set_ylabel("stiffness\n[N·m/rad]")
    axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)


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
    bar.set_label(f"mean {_OBJECTIVES[objective]},\nbest over other axes")
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
    axis.set_ylabel(f"mean {_OBJECTIVES[objective]}")
    figure.suptitle("Sweep")
    return figure


def draw_tuning(each: Mapping[str, np.ndarray], objective: str) -> Figure:
    """Draw how an objective is distributed over held-out scenarios, one curve a configuration."""
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
    axis.set_xlabel(_OBJECTIVES[objective])
    axis.set_ylabel("share of held-out\nscenarios below [%]")
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, fontsize=8)
    return figure
