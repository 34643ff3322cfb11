"""Revolute joints one after another, as numbers and names; nothing here imports jax."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tuning.kinds.arm.names import numbered, shown

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


def about(axis: str, angle: float) -> Matrix:
    """Return the rotation about a coordinate axis by an angle [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    k = "xyz".index(axis)
    i, j = (k + 1) % 3, (k + 2) % 3
    matrix = np.eye(3)
    matrix[i, i], matrix[j, j], matrix[i, j], matrix[j, i] = c, c, -s, s
    return matrix
