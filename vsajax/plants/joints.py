"""Joints with one elastic transmission: fixed spring, or stiffness set by a second motor.

Letters of Flacco et al., IROS 2011: q link, θ motor, θ_c setpoint position, φ = q − θ deflection.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from vsajax.plants.bodies import Link, Motor
from vsajax.plants.splitting import Accelerations, MechanicalState
from vsajax.plants.springs import AbstractSpring
from vsajax.types import Scalar, as_leaf


class Torques(NamedTuple):
    """What drives a joint [N·m]; a joint reads only the inputs that it has.

    Args:
        motor: on the axis of the motor that moves the link.
        setpoint_motor: on the axis of the motor that sets the stiffness.
        external: from outside, on the link.
        motor1: on the axis of an antagonistic pair's first motor.
        motor2: on the axis of its second motor.
    """

    motor: Float[Array, "..."]
    setpoint_motor: Float[Array, "..."]
    external: Float[Array, "..."]
    motor1: Any = None
    motor2: Any = None

    @classmethod
    def none(cls) -> Torques:
        """Return no torque on any input, at one instant."""
        return cls(*(jnp.zeros(()),) * len(cls._fields))


class Motion(NamedTuple):
    """The true state of a joint, at one instant or over time; setpoint quantities are 0 for a fixed spring.

    Args:
        link_position: q [rad].
        motor_position: θ, on the joint side [rad].
        setpoint_position: θ_c, on the joint side [rad].
        link_velocity: [rad/s].
        motor_velocity: [rad/s].
        setpoint_velocity: [rad/s].
        deflection: φ = q − θ [rad].
        elastic_torque: τ_e [N·m].
        stiffness: σ = ∂τ_e/∂φ [N·m/rad].
        motor_torque: τ, on the motor axis [N·m].
    """

    link_position: Float[Array, "..."]
    motor_position: Float[Array, "..."]
    setpoint_position: Float[Array, "..."]
    link_velocity: Float[Array, "..."]
    motor_velocity: Float[Array, "..."]
    setpoint_velocity: Float[Array, "..."]
    deflection: Float[Array, "..."]
    elastic_torque: Float[Array, "..."]
    stiffness: Float[Array, "..."]
    motor_torque: Float[Array, "..."]


class AbstractJoint(eqx.Module):
    """A joint that `plants.simulate` can run."""

    @abstractmethod
    def rest(self) -> MechanicalState:
        """Return the state from which simulations start."""

    @abstractmethod
    def damping_rates(self) -> tuple[Scalar, ...]:
        """Return each body's viscous damping over inertia, λ [1/s]."""

    @abstractmethod
    def accelerations(self, torques: Torques) -> Accelerations:
        """Return positions -> accelerations without viscous and dry friction [rad/s²]."""

    @abstractmethod
    def friction(self) -> Accelerations | None:
        """Return velocities -> decelerations by dry friction [rad/s²], or `None` where there is none."""

    @abstractmethod
    def observe(self, state: MechanicalState, torques: Torques) -> Any:
        """Return every true quantity in `state`: a NamedTuple with `stiffness` and `elastic_torque` among them."""

    @abstractmethod
    def fastest_rate(self, stiffness: Float[Array, "..."]) -> Float[Array, "..."]:
        """Return the fastest rate that the step size must resolve at `stiffness` [rad/s]."""


class FlexibleJoint(AbstractJoint):
    """A motor drives a link through one spring, eqs. (2)–(3) of Flacco et al., IROS 2011.

    Args:
        link: the driven link.
        motor: the geared motor.
        spring: the transmission's characteristic.
        start: q(0) = θ(0) [rad].
    """

    link: Link
    motor: Motor
    spring: AbstractSpring
    start: Scalar = eqx.field(converter=as_leaf, default=0.0)

    def rest(self) -> MechanicalState:
        """Return the undeflected joint at rest at `start`."""
        zero = jnp.zeros_like(self.start)
        return MechanicalState((self.start, self.start), (zero, zero))

    def damping_rates(self) -> tuple[Scalar, ...]:
        """Return (D_q/M, D_θ/B)."""
        return (self.link.damping / self.link.inertia, self.motor.damping / self.motor.inertia)

    def accelerations(self, torques: Torques) -> Accelerations:
        """Return the accelerations of link and motor."""

        def accelerate(positions: tuple[Scalar, ...]) -> tuple[Scalar, ...]:
            position, motor_position = positions
            elastic = self.spring.torque(jnp.zeros_like(position), position - motor_position)
            return (
                (torques.external - elastic - self.link.load(position)) * (1.0 / self.link.inertia),
                self.motor.acceleration(torques.motor + elastic * (1.0 / self.motor.gear_ratio)),
            )

        return accelerate

    def friction(self) -> Accelerations | None:
        """Return the dry friction of link and motor."""
        if self.link.friction is None and self.motor.friction is None:
            return None
        return lambda velocities: (
            link_deceleration(self.link, velocities[0]),
            motor_deceleration(self.motor, velocities[1]),
        )

    def observe(self, state: MechanicalState, torques: Torques) -> Motion:
        """Return every true quantity of the joint in `state`."""
        zero = jnp.zeros_like(state.positions[0])
        return _observe(
            self.spring,
            MechanicalState((*state.positions, zero), (*state.velocities, zero)),
            torques,
        )

    def fastest_rate(self, stiffness: Float[Array, "..."]) -> Float[Array, "..."]:
        """Return the elastic mode's frequency, or the rate of dry friction where that is faster."""
        return _fastest_rate(self.link, (self.motor,), stiffness)


class SerialJoint(AbstractJoint):
    """A principal motor moves the link, a secondary motor sets its stiffness: eq. (5), e.g. the AwAS.

    Args:
        link: the driven link.
        motor: the principal motor.
        setpoint_motor: the motor that sets the stiffness.
        spring: the transmission, whose characteristic depends on the setpoint.
        setpoint_start: θ_c(0) [rad].
        start: q(0) = θ(0) [rad].
    """

    link: Link
    motor: Motor
    setpoint_motor: Motor
    spring: AbstractSpring
    setpoint_start: Scalar = eqx.field(converter=as_leaf, default=0.0)
    start: Scalar = eqx.field(converter=as_leaf, default=0.0)

    def rest(self) -> MechanicalState:
        """Return the undeflected joint at rest at `start` and `setpoint_start`."""
        zero = jnp.zeros_like(self.start)
        return MechanicalState((self.start, self.start, self.setpoint_start), (zero, zero, zero))

    def damping_rates(self) -> tuple[Scalar, ...]:
        """Return (D_q/M, D_θ/B, D_θc/B_c)."""
        secondary = self.setpoint_motor
        return (
            self.link.damping / self.link.inertia,
            self.motor.damping / self.motor.inertia,
            secondary.damping / secondary.inertia,
        )

    def accelerations(self, torques: Torques) -> Accelerations:
        """Return the accelerations of link, principal and secondary motor."""

        def accelerate(positions: tuple[Scalar, ...]) -> tuple[Scalar, ...]:
            position, motor_position, setpoint = positions
            deflection = position - motor_position
            elastic = self.spring.torque(setpoint, deflection)
            coupling = self.spring.coupling(setpoint, deflection)
            secondary = self.setpoint_motor
            return (
                (torques.external - elastic - self.link.load(position)) * (1.0 / self.link.inertia),
                self.motor.acceleration(torques.motor + elastic * (1.0 / self.motor.gear_ratio)),
                secondary.acceleration(torques.setpoint_motor - coupling * (1.0 / secondary.gear_ratio)),
            )

        return accelerate

    def friction(self) -> Accelerations | None:
        """Return the dry friction of link and both motors."""
        if all(body.friction is None for body in (self.link, self.motor, self.setpoint_motor)):
            return None
        return lambda velocities: (
            link_deceleration(self.link, velocities[0]),
            motor_deceleration(self.motor, velocities[1]),
            motor_deceleration(self.setpoint_motor, velocities[2]),
        )

    def observe(self, state: MechanicalState, torques: Torques) -> Motion:
        """Return every true quantity of the joint in `state`."""
        return _observe(self.spring, state, torques)

    def fastest_rate(self, stiffness: Float[Array, "..."]) -> Float[Array, "..."]:
        """Return the elastic mode's frequency, or the rate of dry friction where that is faster."""
        return _fastest_rate(self.link, (self.motor, self.setpoint_motor), stiffness)


def link_deceleration(link: Link, velocity: Scalar) -> Scalar:
    """Return the deceleration of a link by dry friction [rad/s²]."""
    return jnp.zeros_like(velocity) if link.friction is None else link.friction(velocity) / link.inertia


def motor_deceleration(motor: Motor, velocity: Scalar) -> Scalar:
    """Return the deceleration of a motor by dry friction [rad/s²]."""
    return jnp.zeros_like(velocity) if motor.friction is None else motor.acceleration(motor.friction(velocity))


def _observe(spring: AbstractSpring, state: MechanicalState, torques: Torques) -> Motion:
    position, motor_position, setpoint = state.positions
    deflection = position - motor_position
    link_velocity, motor_velocity, setpoint_velocity = state.velocities
    return Motion(
        position,
        motor_position,
        setpoint,
        link_velocity,
        motor_velocity,
        setpoint_velocity,
        deflection,
        spring.torque(setpoint, deflection),
        spring.stiffness(setpoint, deflection),
        torques.motor,
    )


def _fastest_rate(link: Link, motors: tuple[Motor, ...], stiffness: Float[Array, "..."]) -> Float[Array, "..."]:
    principal = motors[0]
    compliance = 1.0 / link.inertia + 1.0 / (principal.inertia * principal.gear_ratio**2)
    rate = jnp.sqrt(jnp.abs(stiffness) * compliance)
    # The explicit midpoint treatment of dry friction is accurate while its rate times h stays below one;
    # ω h ≤ 0.025 holds elastic modes forty times finer, hence the factor.
    for body, inertia in ((link, link.inertia), *((m, m.inertia * m.gear_ratio) for m in motors)):
        if body.friction is not None:
            rate = jnp.maximum(rate, 0.05 * body.friction.torque / (inertia * body.friction.velocity_scale))
    return rate
