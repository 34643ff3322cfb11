"""The picture of a simulated recording."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from tuning.pictures.style import ESTIMATE, TRUTH, new_figure, plain

_LABELS = {
    "link_position": "link\nposition [rad]",
    "motor_position": "motor\nposition [rad]",
    "setpoint_position": "set-point\nposition [rad]",
    "motor_torque": "motor\ntorque [N·m]",
    "elastic_torque": "elastic\ntorque [N·m]",
    "deflection": "deflection\n[mrad]",
    "true_stiffness": "true stiffness\n[N·m/rad]",
}


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
