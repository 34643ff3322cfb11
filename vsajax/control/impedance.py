"""The Cartesian impedance controller (12) of an arm with elastic joints, at the motors."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from vsajax import numerics
from vsajax.arms import SerialArm
from vsajax.control.spectrum import eigen
from vsajax.types import Scalar, as_leaf

Joints = Float[Array, " joints"]
Matrix = Float[Array, "3 3"]


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
    stiffness: Matrix = eqx.field(converter=as_leaf)
    posture: Joints = eqx.field(converter=as_leaf)
    posture_stiffness: Scalar = eqx.field(converter=as_leaf, default=20.0)
    damping: Matrix = eqx.field(converter=as_leaf, default_factory=lambda: jnp.zeros((3, 3)))
    posture_damping: Scalar = eqx.field(converter=as_leaf, default=0.0)

    def damped(self, ratio: Scalar | float, motor_inertia: Scalar | float) -> CartesianImpedance:
        """Return the controller with D and d_n for a damping ratio of the motors' motion, at its posture.

        With Λ = (J B⁻¹ Jᵀ)⁻¹, the motors' inertia at the hand, D = 2ζ Λ^½ (Λ^-½ K Λ^-½)^½ Λ^½ damps every mode of
        Λ and K by ζ, and d_n = 2ζ √(B k_n).

        Args:
            ratio: ζ.
            motor_inertia: B [kg·m²].
        """
        jacobian = self.arm.position_jacobian(self.posture)
        root = _power(jacobian @ jacobian.T / motor_inertia, -0.5)
        inverse_root = _power(jacobian @ jacobian.T / motor_inertia, 0.5)
        modes = _power(numerics.symmetric_part(inverse_root @ self.stiffness @ inverse_root), 0.5)
        damping = 2.0 * ratio * root @ modes @ root
        posture_damping = 2.0 * ratio * jnp.sqrt(motor_inertia * self.posture_stiffness)
        return CartesianImpedance(
            self.arm,
            self.stiffness,
            self.posture,
            self.posture_stiffness,
            numerics.symmetric_part(damping),
            posture_damping,
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
        seen = jacobian.T @ numerics.solve_square(jacobian @ jacobian.T, (jacobian @ posture)[:, None])[:, 0]
        return -jacobian.T @ force - (posture - seen)


def _power(matrix: Matrix, exponent: float) -> Matrix:
    values, vectors = eigen(matrix)
    return (vectors * values**exponent) @ vectors.T
