"""The pictures of a log's report: torque over deflection, stiffness over amplitude, and the clock."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tuning.kinds.log.answer import Answer
from tuning.logs.characteristic import Characteristic, directions
from tuning.logs.clock import GAP, ClockReport
from tuning.logs.reading import RecordingTable
from tuning.pictures.style import ESTIMATE, OTHER, QUIET, TRUTH, new_figure, plain, thin

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
