"""Serial arms of revolute joints: where the hand is, and how it moves with the joints.

Letters of Petit, Albu-Schäffer, *Cartesian impedance control for a variable stiffness robot arm*: q joint
positions, J Jacobian, f wrench at the hand. Positions in metres, rotations as matrices, wrenches as force and
moment at the hand in the base frame.
"""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from vsajax import numerics
from vsajax.types import Scalar, as_leaf

Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]


class Pose(NamedTuple):
    """A place and an orientation in the base frame.

    Args:
        position: [m].
        rotation: its columns are the axes of the frame.
    """

    position: Vector
    rotation: Matrix


class SerialArm(eqx.Module):
    """A chain of revolute joints, each after a fixed step and turn from the one before.

    Frame i follows frame i−1 by a translation, a fixed rotation and a turn by qᵢ about an axis of its own; the
    hand follows the last frame by a translation and a rotation.

    Args:
        offsets: of the joints, in the frame before [m].
        rotations: fixed, from the frame before.
        axes: unit vectors of the joints, in their own frame.
        tool_offset: of the hand, in the last frame [m].
        tool_rotation: of the hand, from the last frame.
    """

    offsets: Float[Array, "joints 3"] = eqx.field(converter=as_leaf)
    rotations: Float[Array, "joints 3 3"] = eqx.field(converter=as_leaf)
    axes: Float[Array, "joints 3"] = eqx.field(converter=as_leaf)
    tool_offset: Vector = eqx.field(converter=as_leaf)
    tool_rotation: Matrix = eqx.field(converter=as_leaf, default_factory=lambda: np.eye(3))

    def __check_init__(self):
        """Check that the parts belong together."""
        joints = self.offsets.shape[0]
        if joints < 1 or self.rotations.shape[0] != joints or self.axes.shape[0] != joints:
            raise ValueError(
                f"an arm needs one offset, rotation and axis a joint, and at least one joint; got {joints}, "
                f"{self.rotations.shape[0]} and {self.axes.shape[0]}"
            )

    @property
    def joints(self) -> int:
        """Number of joints."""
        return self.offsets.shape[0]

    def frames(self, positions: Float[Array, " joints"]) -> list[Pose]:
        """Return the pose of every joint's frame, and last that of the hand.

        Args:
            positions: q [rad].
        """
        place, turned = jnp.zeros(3), jnp.eye(3)
        found = []
        for i in range(self.joints):
            place = place + turned @ self.offsets[i]
            turned = turned @ self.rotations[i] @ rotation_about(self.axes[i], positions[i])
            found.append(Pose(place, turned))
        found.append(Pose(place + turned @ self.tool_offset, turned @ self.tool_rotation))
        return found

    def forward(self, positions: Float[Array, " joints"]) -> Pose:
        """Return the pose of the hand."""
        return self.frames(positions)[-1]

    def jacobian(self, positions: Float[Array, " joints"]) -> Float[Array, "6 joints"]:
        """Return J: the hand's velocity [m/s] and angular velocity [rad/s], in the base frame, per q̇."""
        *frames, hand = self.frames(positions)
        return point_jacobian(self.axes, frames, hand.position)

    def position_jacobian(self, positions: Float[Array, " joints"]) -> Float[Array, "3 joints"]:
        """Return the rows of J that move the hand's position."""
        return self.jacobian(positions)[:3]

    def load_stiffness(
        self, positions: Float[Array, " joints"], wrench: Float[Array, "6"]
    ) -> Float[Array, "joints joints"]:
        """Return −∂(Jᵀf)/∂q of a wrench that keeps its value while the arm moves [N·m/rad].

        It is the second term of (1) with the sign of the text above it: the joint stiffness that holds the hand at
        K_J = −∂τ/∂q = JᵀK_C J − (∂Jᵀ/∂q) K_C Δx. Printed in (1) is +∂τ/∂q. Symmetric for a force; not for a
        moment.

        Args:
            positions: q [rad].
            wrench: on the hand: force [N] and moment [N·m].
        """
        return -jax.jacfwd(lambda q: self.jacobian(q).T @ wrench)(positions)


def point_jacobian(axes: Float[Array, "joints 3"], frames: list[Pose], point: Vector) -> Float[Array, "6 _"]:
    """Return the Jacobian of a point on the last of `frames`; columns of later joints are left out."""
    columns = []
    for axis, frame in zip(axes, frames, strict=False):
        direction = frame.rotation @ axis
        columns.append(jnp.concatenate([jnp.cross(direction, point - frame.position), direction]))
    return jnp.stack(columns, axis=1)


def rotation_about(axis: Vector, angle: Scalar) -> Matrix:
    """Return the rotation by `angle` [rad] about a unit vector, by Rodrigues' formula."""
    x, y, z = axis
    zero = jnp.zeros_like(x)
    cross = jnp.stack([jnp.stack([zero, -z, y]), jnp.stack([z, zero, -x]), jnp.stack([-y, x, zero])])
    return jnp.eye(3) + numerics.sin(angle) * cross + (1.0 - numerics.cos(angle)) * (cross @ cross)


def scaled_rows(jacobian: Float[Array, "6 joints"], length: Scalar | float) -> Float[Array, "6 joints"]:
    """Return T J with T = diag(1, 1, 1, l, l, l): rotations as displacements at a distance l [m].

    Eigenvalues of a 6 × 6 compliance in mixed units mean nothing; in these coordinates all entries are [m/N].
    A stiffness goes over by K → T⁻¹ K T⁻¹.
    """
    return jacobian * task_scale(length)[:, None]


def task_scale(length: Scalar | float) -> Float[Array, "6"]:
    """Return the diagonal of T: 1 for translations, the length l [m] for rotations."""
    one = jnp.ones(3)
    return jnp.concatenate([one, length * one])
