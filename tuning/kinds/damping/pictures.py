"""The picture of a simulated swing."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from tuning.pictures.style import ESTIMATE, OTHER, QUIET, TRUTH, new_figure, plain


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
