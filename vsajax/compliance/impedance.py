"""The Cartesian impedance controller (12) of an arm with elastic joints, at the motors."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from vsajax import numerics
from vsajax.arms import SerialArm
from vsajax.solvers.spectrum import eigen
from vsajax.types import Scalar, as_leaf

Joints = Float[Array, " joints"]
Matrix = Float[Array, "m m"]

_FLATTEST = 1e-12
"""Smallest eigenvalue of J Jᵀ that damping is designed for, relative to the largest."""


def design_damping(
    jacobian: Float[Array, "m joints"], stiffness: Matrix, ratio: Scalar | float, motor_inertia: Scalar | float
) -> Matrix:
    """Return the D that damps every mode of K and of the motors' inertia at the hand by ζ [N·s/m].

    With Λ = (J B⁻¹ Jᵀ)⁻¹ it is D = 2ζ Λ^½ (Λ^-½ K Λ^-½)^½ Λ^½.

    Args:
        jacobian: J.
        stiffness: K [N/m].
        ratio: ζ.
        motor_inertia: B [kg·m²].
    """
    values, vectors = eigen(jacobian @ jacobian.T / motor_inertia)
    spread = jnp.sqrt(jnp.maximum(values, _FLATTEST * values.max()))
    inverse_root, root = (vectors * spread) @ vectors.T, (vectors / spread) @ vectors.T
    values, vectors = eigen(numerics.symmetric_part(inverse_root @ stiffness @ inverse_root))
    modes = (vectors * jnp.sqrt(values)) @ vectors.T
    return numerics.symmetric_part(2.0 * ratio * root @ modes @ root)


def posture_damping(ratio: Scalar | float, motor_inertia: Scalar | float, stiffness: Scalar) -> Scalar:
    """Return d_n = 2ζ √(B k_n), the damping of the posture [N·m·s/rad].

    Args:
        ratio: ζ.
        motor_inertia: B [kg·m²].
        stiffness: k_n [N·m/rad].
    """
    return 2.0 * ratio * jnp.sqrt(motor_inertia * stiffness)


def impedance_torque(
    jacobian: Float[Array, "m joints"], force: Float[Array, " m"], posture_torque: Joints, *, ridge: float = 0.0
) -> Joints:
    """Return −Jᵀ f − N τ of (12), with N = I − J⁺ J [N·m].

    Args:
        jacobian: J.
        force: f, of the hand's springs and dampers [N].
        posture_torque: τ, of the posture's, before it is projected [N·m].
        ridge: on J Jᵀ, relative to its trace; with some the torque is finite at a singular pose too.
    """
    square = jacobian @ jacobian.T
    square = square + ridge * jnp.trace(square) * jnp.eye(square.shape[0])
    seen = jacobian.T @ numerics.solve_square(square, (jacobian @ posture_torque)[:, None])[:, 0]
    return -jacobian.T @ force - (posture_torque - seen)


class CartesianImpedance(eqx.Module):
    """u = −Jᵀ [K (x − x_d) + D ẋ] − N [k_n (v − v_d) + d_n v̇], with J and x at the positions v.

    The paper's (12) leaves open D, where x and J are evaluated, and what the motors do that the hand does not see.
    Here v are joint positions that the caller derives from the motors' (see `arm_loop.View`), D and d_n are
    designed by `damped`, and N = I − J⁺J keeps the posture stiffness out of the hand's: 5 N·m/rad that are not
    projected turn 100 into 287 N/m.

    Args:
        arm: kinematics.
        stiffness: K [N/m].
        posture: v_d [rad]; x_d is the hand there.
        posture_stiffness: k_n [N·m/rad]; under gravity it must hold up what the hand's stiffness does not see.
        damping: D [N·s/m].
        posture_damping: d_n [N·m·s/rad].
    """

    arm: SerialArm
    stiffness: Float[Array, "3 3"] = eqx.field(converter=as_leaf)
    posture: Joints = eqx.field(converter=as_leaf)
    posture_stiffness: Scalar = eqx.field(converter=as_leaf, default=20.0)
    damping: Float[Array, "3 3"] = eqx.field(converter=as_leaf, default_factory=lambda: jnp.zeros((3, 3)))
    posture_damping: Scalar = eqx.field(converter=as_leaf, default=0.0)

    def damped(self, ratio: Scalar | float, motor_inertia: Scalar | float) -> CartesianImpedance:
        """Return the controller with D and d_n for a damping ratio of the motors' motion, at its posture.

        D is that of `design_damping`, d_n = 2ζ √(B k_n).

        Args:
            ratio: ζ.
            motor_inertia: B [kg·m²].
        """
        return CartesianImpedance(
            self.arm,
            self.stiffness,
            self.posture,
            self.posture_stiffness,
            design_damping(self.arm.position_jacobian(self.posture), self.stiffness, ratio, motor_inertia),
            posture_damping(ratio, motor_inertia, self.posture_stiffness),
        )

    def torque(self, positions: Joints, velocities: Joints) -> Joints:
        """Return the motor torques without gravity's [N·m].

        Args:
            positions: v [rad].
            velocities: v̇ [rad/s].
        """
        jacobian = self.arm.position_jacobian(positions)
        offset = self.arm.forward(positions).position - self.arm.forward(self.posture).position
        force = self.stiffness @ offset + self.damping @ (jacobian @ velocities)
        posture = self.posture_stiffness * (positions - self.posture) + self.posture_damping * velocities
        return impedance_torque(jacobian, force, posture)
