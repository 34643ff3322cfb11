"""The pictures of a log's report: torque over deflection, stiffness over amplitude, and the clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from tuning.logs.characteristic import Characteristic, directions
from tuning.logs.clock import GAP, ClockReport
from tuning.pictures.style import ESTIMATE, OTHER, QUIET, TRUTH, new_figure, thin

_WIDTH, _HEIGHT = 6.4, 4.0


def draw_loop(deflection: np.ndarray, torque: np.ndarray, line: Characteristic) -> Figure:
    """Draw torque over deflection, on the way up and on the way down, with the fitted line."""
    figure, axis = new_figure(_WIDTH, _HEIGHT)
    way = directions(deflection)
    for direction, colour, label in ((1.0, ESTIMATE, "rising"), (-1.0, OTHER, "falling")):
        chosen = thin(np.flatnonzero(way == direction), 6000)
        axis.plot(
            1e3 * deflection[chosen], torque[chosen], ".", color=colour, markersize=2, label=label, rasterized=True
        )
    ends = np.array([deflection.min(), deflection.max()])
    axis.plot(
        1e3 * ends,
        line.torque_at_zero + line.stiffness * ends,
        "--",
        color=TRUTH,
        label=f"{line.stiffness:.5g} N·m/rad, R² {line.r_squared:.4f}",
    )
    axis.set_xlabel("deflection, as the torque lags [mrad]")
    axis.set_ylabel("torque [N·m]")
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, fontsize=8, markerscale=4)
    return figure


def draw_levels(line: Characteristic) -> Figure:
    """Draw tangent and secant over amplitude, and the secants of swings from a turning point."""
    figure, axis = new_figure(_WIDTH, _HEIGHT)
    amplitude = [1e3 * level.amplitude for level in line.levels]
    axis.plot(amplitude, [level.secant for level in line.levels], "o-", color=ESTIMATE, label="secant about rest")
    axis.plot(amplitude, [level.tangent for level in line.levels], "s:", color=QUIET, label="tangent there")
    if line.swings:
        turned = [1e3 * swing.amplitude for swing in line.swings]
        axis.plot(
            turned, [s.secant for s in line.swings], "^-", color=OTHER, label="secant of a swing from a turn"
        )
    axis.axhline(line.stiffness, linestyle="--", color=TRUTH, linewidth=1, label="line through all")
    axis.set_xlim(left=0.0)
    axis.set_xlabel("amplitude [mrad]")
    axis.set_ylabel("stiffness [N·m/rad]")
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, fontsize=8)
    return figure


def draw_clock(time: np.ndarray, clock: ClockReport) -> Figure:
    """Draw the time steps, gaps marked."""
    figure, axis = new_figure(_WIDTH, 2.6)
    steps = 1e3 * np.diff(time)
    is_gap = steps > 1e3 * GAP * clock.median
    usual = thin(np.flatnonzero(~is_gap), 6000)
    axis.plot(time[1:][usual], steps[usual], ".", color=QUIET, markersize=2, rasterized=True, label="steps")
    if is_gap.any():
        axis.plot(time[1:][is_gap], steps[is_gap], "x", color=OTHER, markersize=5, label="gaps")
    axis.axhline(1e3 * clock.median, linestyle="--", color=TRUTH, linewidth=1, label="median")
    if steps.max() > 3.0 * steps.min():
        axis.set_yscale("log")
    else:
        axis.set_ylim(0.0, 1.3 * float(steps.max()))
    axis.set_xlabel("time [s]")
    axis.set_ylabel("time step [ms]")
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, fontsize=8)
    return figure


def draw_tried(rows: Mapping[str, np.ndarray], paths: Sequence[str]) -> Figure:
    """Draw the objective of every point tried over each number."""
    figure, axes = new_figure(3.4 * len(paths), 3.4, 1, len(paths), squeeze=False, sharey=True)
    refined = rows["stage"] == "refine"
    best = int(np.nanargmin(rows["objective"]))
    for axis, path in zip(axes[0], paths, strict=True):
        values = rows[path]
        for chosen, colour, label in ((~refined, QUIET, "screened"), (refined, ESTIMATE, "refined")):
            axis.plot(values[chosen], rows["objective"][chosen], "o", color=colour, markersize=3.5, label=label)
        axis.plot(values[best], rows["objective"][best], "*", color=OTHER, markersize=11, label="best")
        if values.min() > 0 and values.max() > 10 * values.min():
            axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_xlabel(path.removeprefix("estimator."), fontsize=8)
    axes[0, 0].set_ylabel("objective, training part [%]")
    axes[0, 0].legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, fontsize=8)
    return figure
