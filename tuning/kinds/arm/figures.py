"""The picture of a design for one pose: the joints within their bounds, and the hand's stiffness as ellipses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from tuning.kinds.arm.study import ArmStudy
from tuning.pictures.style import ESTIMATE, OTHER, QUIET, TRUTH, new_figure, plain

_PLANES = (("x", "y"), ("x", "z"))


def draw_pose(study: ArmStudy, result: Mapping[str, Any]) -> Figure:
    """Draw what `PoseDesign.as_tables` says of a design.

    The boundary of an ellipse is the force by displacement [N/m] that each direction n meets: K n.

    Args:
        study: of the arm.
        result: of its pose; one without numbers leaves its part empty.
    """
    figure, axes = new_figure(11.0, 3.6, 1, 3, width_ratios=(1.2, 1.0, 1.0))
    _draw_joints(axes[0], study, result)
    for axis, plane in zip(axes[1:], _PLANES, strict=True):
        _draw_ellipses(axis, study, result, plane)
    axes[1].legend(loc="lower left", bbox_to_anchor=(-0.1, 1.0), ncols=4, fontsize=8)
    return figure


def _draw_joints(axis: Any, study: ArmStudy, result: Mapping[str, Any]) -> None:
    names, found = result["joints"], result["joint_stiffness"]
    lower, upper = (
        np.broadcast_to(np.asarray(v, float), len(names)) for v in (study.joints.lower, study.joints.upper)
    )
    places = np.arange(len(names))
    axis.vlines(places, lower, upper, color=QUIET, linewidth=6.0, label="bounds")
    held = [value is not None for value in found]
    axis.plot(places[held], [value for value in found if value is not None], "o", color=ESTIMATE, label="designed")
    axis.set_xticks(places, [plain(name) for name in names], rotation=30.0 if _are_long(names) else 0.0)
    axis.set(ylabel="stiffness of the joints [N·m/rad]", ylim=(0.0, 1.08 * float(upper.max())))
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, fontsize=8)


def _are_long(names: Sequence[str]) -> bool:
    return sum(map(len, names)) > 40


def _draw_ellipses(axis: Any, study: ArmStudy, result: Mapping[str, Any], plane: tuple[str, str]) -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    around = np.stack([np.cos(angle), np.sin(angle)])
    rows = ["xyz".index(name) for name in plane]
    matrices = {"desired": study.task.matrix()} | {
        name: result.get(f"{name}_stiffness") for name in ("serial", "passive", "active")
    }
    styles = {"desired": (TRUTH, "-"), "serial": (ESTIMATE, "--"), "passive": (OTHER, "-"), "active": (QUIET, "-")}
    for name, matrix in matrices.items():
        if matrix is None or any(value is None for row in matrix for value in row):
            continue
        colour, style = styles[name]
        force = np.asarray(matrix, float)[np.ix_(rows, rows)] @ around
        axis.plot(*force, style, color=colour, label=name, linewidth=2.4 if name == "desired" else 1.4)
    axis.set(xlabel=f"stiffness along {plane[0]} [N/m]", ylabel=f"along {plane[1]} [N/m]")
    axis.locator_params(nbins=4)
    axis.set_aspect("equal", adjustable="datalim")
