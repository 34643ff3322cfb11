"""From the table of an arm to its kinematics: joints one by one, Denavit–Hartenberg, URDF."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tuning.arm.study import Arm, DhJoint, Joint, Turn
from tuning.errors import input_error
from vsajax.arms import SerialArm

Matrix = np.ndarray


def build_arm(table: Arm, place: str, folder: Path) -> tuple[SerialArm, np.ndarray]:
    """Return the arm and its joints' ranges [rad], `(joints, 2)`.

    Args:
        table: of the study.
        place: the study's file, for errors.
        folder: where a relative URDF path starts.
    """
    tool = np.array(table.tool.offset), _turned(table.tool.turns)
    if table.urdf is not None:
        return _from_urdf(table, place, folder, tool)
    if table.dh:
        arm, ranges = _from_dh(table.dh, table.convention, tool), table.dh
    else:
        arm, ranges = _from_joints(table.joints, tool), table.joints
    return arm, np.deg2rad([joint.range_deg for joint in ranges])


def _about(axis: str, angle: float) -> Matrix:
    """Return the rotation about a coordinate axis by an angle [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    k = "xyz".index(axis)
    i, j = (k + 1) % 3, (k + 2) % 3
    matrix = np.eye(3)
    matrix[i, i], matrix[j, j], matrix[i, j], matrix[j, i] = c, c, -s, s
    return matrix


def _turned(turns: Sequence[Turn]) -> Matrix:
    total = np.eye(3)
    for turn in turns:
        total = total @ _about(turn.axis, np.deg2rad(turn.degrees))
    return total


def _from_joints(joints: Sequence[Joint], tool: tuple[np.ndarray, Matrix]) -> SerialArm:
    axes = np.array([joint.axis for joint in joints])
    axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    offsets = np.array([joint.offset for joint in joints])
    return SerialArm(offsets, np.stack([_turned(joint.turns) for joint in joints]), axes, *tool)


def _from_dh(joints: Sequence[DhJoint], convention: str, tool: tuple[np.ndarray, Matrix]) -> SerialArm:
    """Return the arm of Denavit–Hartenberg rows, Rz(θ) Tz(d) Tx(a) Rx(α); modified, Rx(α) Tx(a) Rz(θ) Tz(d)."""
    steps = []
    place, turned = np.zeros(3), np.eye(3)
    for joint in joints:
        side, lean = np.array([joint.a, 0.0, 0.0]), _about("x", np.deg2rad(joint.alpha_deg))
        up, start = np.array([0.0, 0.0, joint.d]), _about("z", np.deg2rad(joint.theta_deg))
        if convention == "modified":
            place, turned = place + turned @ side, turned @ lean
        steps.append((place, turned @ start))
        # What is left after the joint belongs to the step of the next.
        place, turned = (up, np.eye(3)) if convention == "modified" else (up + side, lean)
    offsets, rotations = (np.stack(part) for part in zip(*steps, strict=True))
    axes = np.tile([0.0, 0.0, 1.0], (len(joints), 1))
    return SerialArm(offsets, rotations, axes, place + turned @ tool[0], turned @ tool[1])


def _from_urdf(
    table: Arm, place: str, folder: Path, tool: tuple[np.ndarray, Matrix]
) -> tuple[SerialArm, np.ndarray]:
    path = folder / str(table.urdf)
    robot = _read_urdf(path, f"{place}: arm.urdf")
    by_child = {joint.child: joint for joint in robot.joint_map.values()}
    links = sorted(robot.link_map)
    if table.tip not in robot.link_map:
        raise input_error(f"{place}: arm.tip", f"got {table.tip!r}", f"links of {path}: {', '.join(links)}")
    chain, link = [], table.tip
    while link in by_child and link != table.base:
        chain.append(by_child[link])
        link = chain[-1].parent
    if table.base is not None and link != table.base:
        raise input_error(f"{place}: arm.base", f"got {table.base!r}, which is not above {table.tip!r} in {path}")
    offset, turned = np.zeros(3), np.eye(3)
    steps, axes, ranges = [], [], []
    for joint in reversed(chain):
        origin = np.eye(4) if joint.origin is None else np.asarray(joint.origin, float)
        offset, turned = offset + turned @ origin[:3, 3], turned @ origin[:3, :3]
        if joint.type == "fixed":
            continue
        if joint.type not in ("revolute", "continuous"):
            problem = f"joint {joint.name} is {joint.type}; allowed: revolute, continuous, fixed"
            raise input_error(path, problem, "choose base and tip so that the chain leaves it out")
        steps.append((offset, turned))
        axes.append(np.array([1.0, 0.0, 0.0]) if joint.axis is None else np.asarray(joint.axis, float))
        ranges.append(_range_of(joint))
        offset, turned = np.zeros(3), np.eye(3)
    if not steps:
        raise input_error(path, f"has no moving joint between {table.base or link!r} and {table.tip!r}")
    offsets, rotations = (np.stack(part) for part in zip(*steps, strict=True))
    directions = np.stack(axes) / np.linalg.norm(axes, axis=1, keepdims=True)
    arm = SerialArm(offsets, rotations, directions, offset + turned @ tool[0], turned @ tool[1])
    return arm, np.array(ranges)


def _range_of(joint: Any) -> list[float]:
    limit = joint.limit if joint.type == "revolute" else None
    if limit is None or limit.lower is None or limit.upper is None:
        return [-np.pi, np.pi]
    return [float(limit.lower), float(limit.upper)]


def _read_urdf(path: Path, place: str) -> Any:
    try:
        from yourdfpy import URDF  # pyright: ignore[reportMissingImports]
    except ImportError:
        fix = "install it: pip install 'vsajax[urdf]'"
        raise input_error(place, "reading a URDF needs the package yourdfpy", fix) from None
    if not path.is_file():
        raise input_error(place, f"{path}: no such file", "paths start at the study's folder")
    try:
        return URDF.load(str(path), build_scene_graph=False, load_meshes=False, build_collision_scene_graph=False)
    except Exception as error:
        # Its parser raises whatever lxml, numpy or a missing attribute happen to raise.
        raise input_error(place, f"{path} is no URDF that can be read ({error})", "check the file") from None
