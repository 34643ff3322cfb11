"""Agonist-antagonist joints: two motors pull one link through springs that stiffen as they stretch.

Letters of Ménard, Grioli, Bicchi: q₁, q₂ motors, q_L link, φᵢ = q_L − qᵢ deflections, fᵢ spring torques, σᵢ = fᵢ′.
Printed (29) has φᵢ reversed, which in (1)–(3) is an unstable spring.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from vsajax.plants.bodies import Link, Motor
from vsajax.plants.joints import AbstractJoint, Torques, link_deceleration, motor_deceleration
from vsajax.plants.splitting import Accelerations, MechanicalState
from vsajax.plants.springs import AbstractSpring
from vsajax.types import Scalar

Value = Float[Array, "..."]


class AntagonisticMotion(NamedTuple):
    """The true state of an agonist-antagonist joint, at one instant or over time.

    Args:
        link_position: q_L [rad].
        motor1_position: q₁ [rad].
        motor2_position: q₂ [rad].
        link_velocity: [rad/s].
        motor1_velocity: [rad/s].
        motor2_velocity: [rad/s].
        elastic_torque: f₁ + f₂ [N·m].
        stiffness: σ₁ + σ₂ [N·m/rad].
        stiffness_1: σ₁ [N·m/rad].
        stiffness_2: σ₂ [N·m/rad].
        motor1_torque: τ₁ [N·m].
        motor2_torque: τ₂ [N·m].
    """

    link_position: Value
    motor1_position: Value
    motor2_position: Value
    link_velocity: Value
    motor1_velocity: Value
    motor2_velocity: Value
    elastic_torque: Value
    stiffness: Value
    stiffness_1: Value
    stiffness_2: Value
    motor1_torque: Value
    motor2_torque: Value


class AntagonisticJoint(AbstractJoint):
    """Two motor-spring transmissions on one link, eqs. (1)–(3) of Ménard, Grioli, Bicchi.

    Jᵢ q̈ᵢ + bᵢ q̇ᵢ − fᵢ(φᵢ) = τᵢ,  J_L q̈_L + b_L q̇_L + f₁(φ₁) + f₂(φ₂) + g(q_L) = τ_ext.

    Args:
        link: the link.
        motor1: the first motor.
        motor2: the second motor.
        spring1: between the first motor and the link.
        spring2: between the second motor and the link.
    """

    link: Link
    motor1: Motor
    motor2: Motor
    spring1: AbstractSpring
    spring2: AbstractSpring

    def rest(self) -> MechanicalState:
        """Return the joint at rest with all bodies at zero."""
        zero = jnp.zeros_like(self.link.inertia)
        return MechanicalState((zero, zero, zero), (zero, zero, zero))

    def damping_rates(self) -> tuple[Scalar, ...]:
        """Return (b_L/J_L, b₁/J₁, b₂/J₂)."""
        bodies = (self.link, self.motor1, self.motor2)
        return tuple(body.damping / body.inertia for body in bodies)

    def accelerations(self, torques: Torques) -> Accelerations:
        """Return the accelerations of link and motors."""

        def accelerate(positions: tuple[Scalar, ...]) -> tuple[Scalar, ...]:
            link, first, second = positions
            unset = jnp.zeros_like(link)
            pull1 = self.spring1.torque(unset, link - first)
            pull2 = self.spring2.torque(unset, link - second)
            return (
                (torques.external - pull1 - pull2 - self.link.load(link)) * (1.0 / self.link.inertia),
                self.motor1.acceleration(torques.motor1 + pull1 * (1.0 / self.motor1.gear_ratio)),
                self.motor2.acceleration(torques.motor2 + pull2 * (1.0 / self.motor2.gear_ratio)),
            )

        return accelerate

    def friction(self) -> Accelerations | None:
        """Return the dry friction of link and motors."""
        if all(body.friction is None for body in (self.link, self.motor1, self.motor2)):
            return None
        return lambda velocities: (
            link_deceleration(self.link, velocities[0]),
            motor_deceleration(self.motor1, velocities[1]),
            motor_deceleration(self.motor2, velocities[2]),
        )

    def observe(self, state: MechanicalState, torques: Torques) -> AntagonisticMotion:
        """Return every true quantity of the joint in `state`."""
        link, first, second = state.positions
        unset = jnp.zeros_like(link)
        deflections = (link - first, link - second)
        springs = (self.spring1, self.spring2)
        pulls = [spring.torque(unset, phi) for spring, phi in zip(springs, deflections, strict=True)]
        sigmas = [spring.stiffness(unset, phi) for spring, phi in zip(springs, deflections, strict=True)]
        return AntagonisticMotion(
            *state.positions,
            *state.velocities,
            elastic_torque=pulls[0] + pulls[1],
            stiffness=sigmas[0] + sigmas[1],
            stiffness_1=sigmas[0],
            stiffness_2=sigmas[1],
            motor1_torque=torques.motor1,
            motor2_torque=torques.motor2,
        )

    def fastest_rate(self, stiffness: Value) -> Value:
        """Return a bound on the rate that the step must resolve, for a total `stiffness`.

        A body of rate ω under a damping λ ≫ ω creeps at ω²/λ; the exact damping leaves only that to resolve.
        """
        squares = stiffness / self.link.inertia
        for motor in (self.motor1, self.motor2):
            own = stiffness / (motor.inertia * motor.gear_ratio**2)
            squares = squares + own * own / (own + 0.25 * (motor.damping / motor.inertia) ** 2)
        return jnp.sqrt(jnp.abs(squares))
