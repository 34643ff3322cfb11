"""Joints whose stiffness is an input: a mechanism on springs that actuators set, within range and speed."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp

from vsajax.numerics import once
from vsajax.plants.mechanisms import AbstractMechanism, Vector
from vsajax.types import Command, Scalar, as_leaf, optional_leaf


class SwitchedState(NamedTuple):
    """The state of a `SwitchedPlant`, one scalar a joint: q [rad], q̇ [rad/s], k [N·m/rad], θ [rad]."""

    positions: Vector
    velocities: Vector
    stiffness: Vector
    motor_positions: Vector


class StiffnessActuator(eqx.Module):
    """What sets a joint's stiffness: within its range, and no faster than it can.

    Args:
        soft: smallest stiffness, k_min [N·m/rad].
        stiff: largest stiffness, k_max [N·m/rad].
        travel_time: from end to end of the range at a constant rate [s]; `None` for an instant change. The
            qbmove takes 0.1 s.
    """

    soft: Scalar = eqx.field(converter=as_leaf)
    stiff: Scalar = eqx.field(converter=as_leaf)
    travel_time: Scalar | None = eqx.field(converter=optional_leaf, default=None)

    def after(self, stiffness: Scalar, command: Scalar, time: Scalar) -> Scalar:
        """Return the stiffness `time` [s] after it was `stiffness`, under a constant command."""
        wanted = jnp.clip(command, self.soft, self.stiff)
        if self.travel_time is None:
            return wanted
        reach = (self.stiff - self.soft) * (time / self.travel_time)
        return stiffness + jnp.clip(wanted - stiffness, -reach, reach)


class PositionMotor(eqx.Module):
    """A position-controlled motor, θ̇ = sat((θ_cmd − θ)/τ, ±ω_max).

    Args:
        time_constant: τ [s].
        top_speed: ω_max [rad/s].
    """

    time_constant: Scalar = eqx.field(converter=as_leaf)
    top_speed: Scalar = eqx.field(converter=as_leaf)

    def after(self, position: Scalar, command: Scalar, time: Scalar) -> Scalar:
        """Return the position `time` [s] after it was `position`, under a constant command.

        Exact while the speed is either saturated or not over all of `time`.
        """
        way = (command - position) * -jnp.expm1(-time / self.time_constant)
        reach = self.top_speed * time
        return position + jnp.clip(way, -reach, reach)


class SwitchedPlant(eqx.Module):
    """A mechanism with a controlled spring in every joint: torque −kᵢ (qᵢ − θᵢ), eqs. (1)–(2) of Gasparri et al.

    Args:
        mechanism: the links.
        actuator: of the stiffness, alike in every joint.
        motor: of the springs' other ends; `None` where they are moved at once.
    """

    mechanism: AbstractMechanism
    actuator: StiffnessActuator
    motor: PositionMotor | None = None

    def rest(self, stiffness: Scalar) -> SwitchedState:
        """Return the plant at rest at 0 with every joint at `stiffness`."""
        zero, size = jnp.zeros_like(self.actuator.soft), self.mechanism.joints
        return SwitchedState((zero,) * size, (zero,) * size, (stiffness + zero,) * size, (zero,) * size)

    def accelerations(self, state: SwitchedState, external: Vector) -> Vector:
        """Return q̈ under the springs and external joint torques [rad/s²]."""
        torques = tuple(
            e - k * (q - m)
            for e, k, q, m in zip(external, state.stiffness, state.positions, state.motor_positions, strict=True)
        )
        return self.mechanism.accelerations(state.positions, state.velocities, torques)

    def step(
        self, state: SwitchedState, commands: tuple[Command, ...], external: Vector, time: Scalar
    ) -> SwitchedState:
        """Advance by `time` [s] under constant commands and torques: one classical Runge–Kutta step.

        Between switches its order is four. A switch inside a step would make it one: steps end at samples, where
        commands change.
        """

        def actuate(share: float) -> tuple[Vector, Vector]:
            stiffness = tuple(
                self.actuator.after(k, c.stiffness, share * time)
                for k, c in zip(state.stiffness, commands, strict=True)
            )
            motors = tuple(
                c.motor_position if self.motor is None else self.motor.after(m, c.motor_position, share * time)
                for m, c in zip(state.motor_positions, commands, strict=True)
            )
            return stiffness, motors

        def slope(q: Vector, v: Vector, actuated: tuple[Vector, Vector]) -> tuple[Vector, Vector]:
            return v, self.accelerations(SwitchedState(q, v, *actuated), external)

        q, v = state.positions, state.velocities
        start, middle, end = actuate(0.0), once(actuate(0.5)), once(actuate(1.0))
        v1, a1 = once(slope(q, v, start))
        v2, a2 = once(slope(_add(q, v1, 0.5 * time), _add(v, a1, 0.5 * time), middle))
        v3, a3 = once(slope(_add(q, v2, 0.5 * time), _add(v, a2, 0.5 * time), middle))
        v4, a4 = slope(_add(q, v3, time), _add(v, a3, time), end)
        return once(SwitchedState(_weigh(q, v1, v2, v3, v4, time), _weigh(v, a1, a2, a3, a4, time), *end))

    def energy(self, state: SwitchedState, stiffness: Scalar) -> Scalar:
        """Return the energy with every spring at `stiffness`, deflected from 0: V of (24) for k_min [J]."""
        total = self.mechanism.energy(state.positions, state.velocities)
        for q in state.positions:
            total = total + 0.5 * stiffness * q * q
        return total


def _add(values: Vector, slopes: Vector, time: Scalar) -> Vector:
    return tuple(x + time * s for x, s in zip(values, slopes, strict=True))


def _weigh(x: Vector, k1: Vector, k2: Vector, k3: Vector, k4: Vector, time: Scalar) -> Vector:
    return tuple(
        own + (time / 6.0) * (a + 2.0 * (b + c) + d) for own, a, b, c, d in zip(x, k1, k2, k3, k4, strict=True)
    )
