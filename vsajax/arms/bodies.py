"""The masses of an arm: inertia, gravity and the forces of motion."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from vsajax.arms.kinematics import Pose, SerialArm
from vsajax.types import as_leaf

Joints = Float[Array, " joints"]
Motions = Float[Array, "bodies joints 3"]


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
        frames, _ = arm.frames(positions)
        linear, turned = self._motion(arm, frames)
        # In the body's own frame: Rᵀ ω.
        turned = jnp.einsum("bxy,bjx->bjy", frames.rotation, turned)
        kinetic = jnp.einsum("b,bix,bjx->ij", self.masses, linear, linear)
        return kinetic + jnp.einsum("bix,bxy,bjy->ij", turned, self.inertias, turned)

    def load(self, arm: SerialArm, positions: Joints) -> Joints:
        """Return the joint torques g(q) that hold the arm against gravity [N·m]."""
        linear, _ = self._motion(arm, arm.frames(positions)[0])
        return -jnp.einsum("b,bjx,x->j", self.masses, linear, self.gravity)

    def _motion(self, arm: SerialArm, frames: Pose) -> tuple[Motions, Motions]:
        """Return the velocities of the centres of mass and the angular velocities, per joint velocity."""
        centres = frames.position + (frames.rotation * self.centres[:, None, :]).sum(2)
        moves = jnp.asarray(np.tril(np.ones((arm.joints, arm.joints))))[:, :, None]
        directions = moves * arm.directions(frames)
        return jnp.cross(directions, centres[:, None] - frames.position), directions

    def load_stiffness(self, arm: SerialArm, positions: Joints) -> Float[Array, "joints joints"]:
        """Return ∂g/∂q, which adds to the joints' stiffness [N·m/rad]."""
        return jax.jacfwd(lambda q: self.load(arm, q))(positions)

    def motion_torque(self, arm: SerialArm, positions: Joints, velocities: Joints) -> Joints:
        """Return the Coriolis and centrifugal torques, Ṁ q̇ − ½ ∂(q̇ᵀ M q̇)/∂q [N·m]."""

        def momentum(q: Joints) -> Joints:
            return self.inertia(arm, q) @ velocities

        change = jax.jvp(momentum, (positions,), (velocities,))[1]
        return change - 0.5 * jax.grad(lambda q: velocities @ momentum(q))(positions)
