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

Joints = Float[Array, " joints"]


class Pose(NamedTuple):
    """A place and an orientation in the base frame; several have leading axes.

    Args:
        position: [m].
        rotation: its columns are the axes of the frame.
    """

    position: Float[Array, "*many 3"]
    rotation: Float[Array, "*many 3 3"]


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
    tool_offset: Float[Array, "3"] = eqx.field(converter=as_leaf)
    tool_rotation: Float[Array, "3 3"] = eqx.field(converter=as_leaf, default_factory=lambda: np.eye(3))

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

    def frames(self, positions: Joints) -> tuple[Pose, Pose]:
        """Return the poses of all joints' frames, with a leading joint axis, and that of the hand.

        Args:
            positions: q [rad].
        """
        turns = self.rotations @ rotation_about(self.axes, positions)
        place, turned = jnp.zeros(3), jnp.eye(3)
        places, rotations = [], []
        for i in range(self.joints):
            place, turned = place + turned @ self.offsets[i], turned @ turns[i]
            places.append(place)
            rotations.append(turned)
        hand = Pose(place + turned @ self.tool_offset, turned @ self.tool_rotation)
        return Pose(jnp.stack(places), jnp.stack(rotations)), hand

    def forward(self, positions: Joints) -> Pose:
        """Return the pose of the hand."""
        return self.frames(positions)[1]

    def jacobian(self, positions: Joints) -> Float[Array, "6 joints"]:
        """Return J: the hand's velocity [m/s] and angular velocity [rad/s], in the base frame, per q̇."""
        frames, hand = self.frames(positions)
        directions = self.directions(frames)
        linear = jnp.cross(directions, hand.position - frames.position)
        return jnp.concatenate([linear, directions], axis=1).T

    def position_jacobian(self, positions: Joints) -> Float[Array, "3 joints"]:
        """Return the rows of J that move the hand's position."""
        return self.jacobian(positions)[:3]

    def directions(self, frames: Pose) -> Float[Array, "joints 3"]:
        """Return the joints' axes in the base frame."""
        return (frames.rotation * self.axes[:, None, :]).sum(2)

    def load_stiffness(self, positions: Joints, wrench: Float[Array, "6"]) -> Float[Array, "joints joints"]:
        """Return −∂(Jᵀf)/∂q of a wrench that keeps its value while the arm moves [N·m/rad].

        It is the second term of (1) with the sign of the text above it: the joint stiffness is
        K_J = −∂τ/∂q = JᵀK_C J − (∂Jᵀ/∂q) K_C Δx; printed in (1) is +∂τ/∂q. Symmetric for a force, not for a
        moment.

        Args:
            positions: q [rad].
            wrench: on the hand: force [N] and moment [N·m].
        """
        return -jax.jacfwd(lambda q: self.jacobian(q).T @ wrench)(positions)


def rotation_about(axes: Float[Array, "joints 3"], angles: Joints) -> Float[Array, "joints 3 3"]:
    """Return the rotations by `angles` [rad] about unit vectors, by Rodrigues' formula."""
    x, y, z = axes.T
    zero = jnp.zeros_like(x)
    cross = jnp.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    sine, cosine = numerics.sin(angles)[:, None, None], numerics.cos(angles)[:, None, None]
    return jnp.eye(3) + sine * cross + (1.0 - cosine) * (cross @ cross)


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
