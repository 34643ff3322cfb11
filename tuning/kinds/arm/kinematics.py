"""The chain of joints that a study's table of an arm describes; nothing here imports jax."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tuning.files.toml import validate
from tuning.kinds.arm.chain import Chain, Matrix, about
from tuning.kinds.arm.names import numbered
from tuning.kinds.arm.tables import Arm, DhJoint, Joint, Turn
from tuning.kinds.arm.urdf import read_chain


def chain_of(table: Arm, place: str, folder: Path) -> Chain:
    """Return the chain that a study's table of an arm describes.

    Args:
        table: of the study.
        place: the study's file, for errors.
        folder: where a relative URDF path starts.

    Raises:
        InputError: the URDF cannot be read, or does not hold the chain that the table asks for.
    """
    if table.urdf is not None:
        chain = read_chain(folder / table.urdf, table.base, table.tip, f"{place}: arm")
    else:
        chain = _from_dh(table.dh, table.convention) if table.dh else _from_joints(table.joints)
    return chain.with_tool(np.array(table.tool.offset), _turned(table.tool.turns))


def _turned(turns: Sequence[Turn]) -> Matrix:
    total = np.eye(3)
    for turn in turns:
        total = total @ about(turn.axis, np.deg2rad(turn.degrees))
    return total


def _with_ends(joints: Sequence[object]) -> tuple[bool, ...]:
    return (False,) * len(joints)


def _from_joints(joints: Sequence[Joint]) -> Chain:
    axes = np.array([joint.axis for joint in joints])
    axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    offsets = np.array([joint.offset for joint in joints])
    rotations = np.stack([_turned(joint.turns) for joint in joints])
    ranges = np.deg2rad([joint.range_deg for joint in joints])
    tool = np.zeros(3), np.eye(3)
    return Chain(numbered(len(joints)), offsets, rotations, axes, *tool, ranges, _with_ends(joints))


def _from_dh(joints: Sequence[DhJoint], convention: str) -> Chain:
    """Return the arm of Denavit–Hartenberg rows, Rz(θ) Tz(d) Tx(a) Rx(α); modified, Rx(α) Tx(a) Rz(θ) Tz(d)."""
    steps = []
    place, turned = np.zeros(3), np.eye(3)
    for joint in joints:
        side, lean = np.array([joint.a, 0.0, 0.0]), about("x", np.deg2rad(joint.alpha_deg))
        up, start = np.array([0.0, 0.0, joint.d]), about("z", np.deg2rad(joint.theta_deg))
        if convention == "modified":
            place, turned = place + turned @ side, turned @ lean
        steps.append((place, turned @ start))
        # What is left after the joint belongs to the step of the next.
        place, turned = (up, np.eye(3)) if convention == "modified" else (up + side, lean)
    offsets, rotations = (np.stack(part) for part in zip(*steps, strict=True))
    axes = np.tile([0.0, 0.0, 1.0], (len(joints), 1))
    ranges = np.deg2rad([joint.range_deg for joint in joints])
    return Chain(numbered(len(joints)), offsets, rotations, axes, place, turned, ranges, _with_ends(joints))


def parse_arm(tables: Mapping[str, Any], place: str) -> Arm:
    """Return the arm that tables describe; a URDF is read.

    Raises:
        InputError: lists every mistake with its path.
    """
    arm = validate(Arm, dict(tables), place)
    chain_of(arm, place, Path(place).parent)
    return arm
