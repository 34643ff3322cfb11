"""The masses of an arm: inertia, gravity and the forces of motion."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from vsajax.arms.kinematics import SerialArm, point_jacobian
from vsajax.types import as_leaf

Joints = Float[Array, " joints"]


class ArmBodies(eqx.Module):
    """One rigid body on each joint's frame.

    Args:
        masses: [kg]; 0 for a joint that carries none.
        centres: of mass, in the joint's frame [m].
        inertias: about the centre of mass, in the joint's frame [kg·m²].
        gravity: acceleration of free fall in the base frame [m/s²].
    """

    masses: Joints = eqx.field(converter=as_leaf)
    centres: Float[Array, "joints 3"] = eqx.field(converter=as_leaf)
    inertias: Float[Array, "joints 3 3"] = eqx.field(converter=as_leaf)
    gravity: Float[Array, "3"] = eqx.field(converter=as_leaf, default_factory=lambda: np.array([0.0, 0.0, -9.81]))

    def inertia(self, arm: SerialArm, positions: Joints) -> Float[Array, "joints joints"]:
        """Return the inertia matrix M(q) [kg·m²]."""
        frames = arm.frames(positions)[:-1]
        total = jnp.zeros((arm.joints, arm.joints))
        for i, frame in enumerate(frames):
            point = frame.position + frame.rotation @ self.centres[i]
            motion = point_jacobian(arm.axes, frames[: i + 1], point)
            linear, turned = motion[:3], frame.rotation.T @ motion[3:]
            part = self.masses[i] * (linear.T @ linear) + turned.T @ self.inertias[i] @ turned
            total = total.at[: i + 1, : i + 1].add(part)
        return total

    def load(self, arm: SerialArm, positions: Joints) -> Joints:
        """Return the joint torques g(q) that hold the arm against gravity [N·m]."""
        frames = arm.frames(positions)[:-1]
        total = jnp.zeros(arm.joints)
        for i, frame in enumerate(frames):
            point = frame.position + frame.rotation @ self.centres[i]
            linear = point_jacobian(arm.axes, frames[: i + 1], point)[:3]
            total = total.at[: i + 1].add(-self.masses[i] * (linear.T @ self.gravity))
        return total

    def load_stiffness(self, arm: SerialArm, positions: Joints) -> Float[Array, "joints joints"]:
        """Return ∂g/∂q, which adds to the joints' stiffness [N·m/rad]."""
        return jax.jacfwd(lambda q: self.load(arm, q))(positions)

    def motion_torque(self, arm: SerialArm, positions: Joints, velocities: Joints) -> Joints:
        """Return the Coriolis and centrifugal torques, Ṁ q̇ − ½ ∂(q̇ᵀ M q̇)/∂q [N·m]."""

        def momentum(q: Joints) -> Joints:
            return self.inertia(arm, q) @ velocities

        change = jax.jvp(momentum, (positions,), (velocities,))[1]
        return change - 0.5 * jax.grad(lambda q: velocities @ momentum(q))(positions)
