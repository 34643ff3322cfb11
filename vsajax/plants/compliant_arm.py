"""An arm whose joints are springs: motors, springs, links."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from vsajax import numerics
from vsajax.arms import ArmBodies, SerialArm
from vsajax.plants.springs import AbstractSpring
from vsajax.types import as_leaf

Joints = Float[Array, " joints"]


class ArmMotion(NamedTuple):
    """Links and motors of an arm at one instant; motors on the joint side of their gears [rad], [rad/s]."""

    link_position: Joints
    motor_position: Joints
    link_velocity: Joints
    motor_velocity: Joints

    def moved(self, rates: ArmMotion, step: float | Float[Array, ""]) -> ArmMotion:
        """Return the motion a step along its rates."""
        return ArmMotion(*(x + step * rate for x, rate in zip(self, rates, strict=True)))


class CompliantArm(eqx.Module):
    """M(q) q̈ + c(q, q̇) + g(q) = τ_e + Jᵀf, B θ̈ = u − τ_e, with τ_e of the springs between motors and links.

    Args:
        arm: kinematics.
        bodies: masses and gravity.
        spring: the law of all joints.
        setpoints: their presets, see `spring`.
        motor_inertia: B, on the joint side [kg·m²].
        spring_damping: parallel to the springs [N·m·s/rad].
    """

    arm: SerialArm
    bodies: ArmBodies
    spring: AbstractSpring
    setpoints: Joints = eqx.field(converter=as_leaf)
    motor_inertia: Float[Array, "..."] = eqx.field(converter=as_leaf, default=0.5)
    spring_damping: Float[Array, "..."] = eqx.field(converter=as_leaf, default=0.5)

    def elastic_torque(self, link: Joints, motor: Joints) -> Joints:
        """Return τ_e of the springs on the links [N·m]."""
        return self.spring.torque(self.setpoints, motor - link)

    def stiffness(self, link: Joints, motor: Joints) -> Joints:
        """Return the joints' present stiffness [N·m/rad]."""
        return self.spring.stiffness(self.setpoints, motor - link)

    def unbalanced(self, link: Joints, motor: Joints, force: Float[Array, "3"]) -> Joints:
        """Return the torque that accelerates a link at rest, 0 in equilibrium; `force` pulls at the hand [N]."""
        pull = self.arm.position_jacobian(link).T @ force
        return self.elastic_torque(link, motor) + pull - self.bodies.load(self.arm, link)

    def rates(self, motion: ArmMotion, command: Joints, force: Float[Array, "3"]) -> ArmMotion:
        """Return the time derivative of a motion under motor torques `command` and a force at the hand."""
        link, motor, link_velocity, motor_velocity = motion
        damping = self.spring_damping * (motor_velocity - link_velocity)
        driven = self.unbalanced(link, motor, force) + damping
        driven = driven - self.bodies.motion_torque(self.arm, link, link_velocity)
        inverse = numerics.inverse(self.bodies.inertia(self.arm, link))
        motor_torque = command - self.elastic_torque(link, motor) - damping
        return ArmMotion(
            link_velocity, motor_velocity, inverse @ driven, motor_torque / jnp.asarray(self.motor_inertia)
        )
