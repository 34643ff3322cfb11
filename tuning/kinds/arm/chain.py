"""What an arm's kinematics are made of, as numbers and names; nothing here imports jax."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tuning.kinds.arm.names import numbered, shown

if TYPE_CHECKING:
    from tuning.kinds.arm.study import Arm, DhJoint, Joint, Turn

Matrix = np.ndarray

FARTHEST = 1e6
"""Angle [rad] beyond which sine and cosine lose digits, see `vsajax.numerics`."""


@dataclass(frozen=True)
class Chain:
    """Revolute joints, each after a fixed step and turn from the one before.

    Args:
        names: of the joints, from the base to the hand; all different.
        offsets: of the joints, in the frame before, `(joints, 3)` [m].
        rotations: fixed, from the frame before, `(joints, 3, 3)`.
        axes: unit vectors of the joints, in their own frame, `(joints, 3)`.
        tool_offset: of the hand, in the last frame, `(3,)` [m].
        tool_rotation: of the hand, from the last frame, `(3, 3)`.
        ranges: of the joints, low and high, `(joints, 2)` [rad]; half a turn to either side of one without end.
        endless: for each joint, whether it turns for ever.
    """

    names: tuple[str, ...]
    offsets: np.ndarray
    rotations: np.ndarray
    axes: np.ndarray
    tool_offset: np.ndarray
    tool_rotation: np.ndarray
    ranges: np.ndarray
    endless: tuple[bool, ...]

    @property
    def joints(self) -> int:
        """Number of joints."""
        return len(self.names)

    @property
    def is_named(self) -> bool:
        """Whether the joints have names of their own."""
        return self.names != numbered(self.joints)

    @property
    def titles(self) -> list[str]:
        """What each joint is called in a sentence: its number, and its own name where it has one."""
        own = [f" ({shown(name)})" if self.is_named else "" for name in self.names]
        return [f"joint {i + 1}{name}" for i, name in enumerate(own)]

    def with_tool(self, offset: np.ndarray, rotation: Matrix) -> Chain:
        """Return the chain with its hand moved on: a step [m], then a turn, in the frame of the hand so far."""
        place = self.tool_offset + self.tool_rotation @ offset
        return replace(self, tool_offset=place, tool_rotation=self.tool_rotation @ rotation)


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
        from tuning.kinds.arm.urdf import read_chain

        chain = read_chain(folder / table.urdf, table.base, table.tip, f"{place}: arm")
    else:
        chain = _from_dh(table.dh, table.convention) if table.dh else _from_joints(table.joints)
    return chain.with_tool(np.array(table.tool.offset), _turned(table.tool.turns))


def about(axis: str, angle: float) -> Matrix:
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
