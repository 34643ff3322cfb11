"""Controllers that move the motor: PID, bang-bang with bring-back, and PID beside a controlled stiffness."""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp

from vsajax.control.base import AbstractController
from vsajax.types import Command, RunningSum, Scalar, Swing, as_leaf


class PIDState(NamedTuple):
    """The integral of the link's position [rad·s]."""

    integral: RunningSum


class MotorPID(eqx.Module):
    """θ = −(Kp q + Ki ∫q + Kd q̇), both the integral and θ limited: where to move a joint's motor.

    Args:
        proportional: Kp.
        integral: Ki [1/s].
        derivative: Kd [s].
        longest_integral: largest |∫q| [rad·s].
        reach: largest |θ| [rad].
    """

    proportional: Scalar = eqx.field(converter=as_leaf)
    integral: Scalar = eqx.field(converter=as_leaf)
    derivative: Scalar = eqx.field(converter=as_leaf)
    longest_integral: Scalar = eqx.field(converter=as_leaf, default=0.2)
    reach: Scalar = eqx.field(converter=as_leaf, default=1.5)

    def init(self, swing: Swing) -> PIDState:
        """Return the state before the first instant."""
        return PIDState(jnp.zeros_like(swing.position))

    def step(self, state: PIDState, swing: Swing) -> tuple[PIDState, Scalar]:
        """Return (state, θ) [rad]."""
        limit = self.longest_integral
        integral = jnp.clip(state.integral + swing.position * swing.dt, -limit, limit)
        wanted = self.proportional * swing.position + self.integral * integral + self.derivative * swing.velocity
        return PIDState(integral), jnp.clip(-wanted, -self.reach, self.reach)


class PIDPosition(AbstractController):
    """A `MotorPID` at a constant stiffness.

    Its gains suit one inertia. With an ideal motor on I q̈ + b q̇ + k (q − θ) = 0 it is stable if and only if
    I Ki < (b + k Kd)(1 + Kp).

    Args:
        stiffness: [N·m/rad].
        proportional: Kp.
        integral: Ki [1/s].
        derivative: Kd [s].
        longest_integral: largest |∫q| [rad·s].
        reach: largest |θ| [rad].
    """

    stiffness: Scalar = eqx.field(converter=as_leaf)
    proportional: Scalar = eqx.field(converter=as_leaf)
    integral: Scalar = eqx.field(converter=as_leaf)
    derivative: Scalar = eqx.field(converter=as_leaf)
    longest_integral: Scalar = eqx.field(converter=as_leaf, default=0.2)
    reach: Scalar = eqx.field(converter=as_leaf, default=1.5)

    @property
    def law(self) -> MotorPID:
        """Where the motor goes."""
        return MotorPID(self.proportional, self.integral, self.derivative, self.longest_integral, self.reach)

    def init(self, swing: Swing) -> PIDState:
        """Return the state before the first instant."""
        return self.law.init(swing)

    def step(self, state: PIDState, swing: Swing) -> tuple[PIDState, Command]:
        """Return the motor position at the constant stiffness."""
        state, motor = self.law.step(state, swing)
        return state, Command(self.stiffness, motor)


class CombinedState(NamedTuple):
    """The states of what sets the stiffness and of what moves the motor."""

    stiffness: Any
    motor: PIDState


class Combined(AbstractController):
    """Damps by the stiffness and by the motor at once: one controller for each, both on the same swing.

    With θ moving, what the spring takes from the link is k (q − θ) q̇, so the stiffness follows the deflection
    q − θ as in law (23). Each helps where the other cannot: a motor is too slow for a hard blow, and law (23)
    needs a swing that is still large against the noise.

    Args:
        stiffness: sets the stiffness; where it would have the motor is not followed.
        motor: moves the motor.
    """

    stiffness: AbstractController
    motor: MotorPID

    def init(self, swing: Swing) -> CombinedState:
        """Return the states before the first instant."""
        return CombinedState(self.stiffness.init(swing), self.motor.init(swing))

    def step(self, state: CombinedState, swing: Swing) -> tuple[CombinedState, Command]:
        """Return the stiffness of the one and the motor position of the other."""
        stiffness, command = self.stiffness.step(state.stiffness, swing)
        motor, position = self.motor.step(state.motor, swing)
        return CombinedState(stiffness, motor), Command(command.stiffness, position)


class BangBangState(NamedTuple):
    """Where the controller is.

    Args:
        velocity: of the link, with its lead, at the last instant [rad/s].
        target: where the motor was sent [rad].
        stops: how often the link was stopped.
        returning: time since the motor began to come back [s]; negative before.
    """

    velocity: Scalar
    target: Scalar
    stops: Scalar
    returning: Scalar


class BangBangPosition(AbstractController):
    """Bang-bang position control of Petit, Ott, Albu-Schäffer, ICRA 2014: stop the link, then bring it back.

    Each time the link turns, the motor goes to where it is, which takes the load off the spring. Once a turn finds
    the spring hardly deflected, or after some stops, the motor brings the link back on a minimum-jerk path. A link
    that keeps swinging meanwhile is the method's weakness.

    Args:
        stiffness: [N·m/rad].
        return_time: T_b of the way back [s].
        tolerance: δ, deflection below which the link counts as stopped [rad].
        lead: τ of the velocity that turns, q̇ + τ q̈ [s].
        most_stops: after which the way back begins in any case.
    """

    stiffness: Scalar = eqx.field(converter=as_leaf)
    return_time: Scalar = eqx.field(converter=as_leaf)
    tolerance: Scalar = eqx.field(converter=as_leaf)
    lead: Scalar = eqx.field(converter=as_leaf, default=0.0)
    most_stops: Scalar = eqx.field(converter=as_leaf, default=6.0)

    def init(self, swing: Swing) -> BangBangState:
        """Return the state of a joint at rest."""
        zero = jnp.zeros_like(swing.position)
        return BangBangState(swing.velocity, zero, zero, zero - 1.0)

    def step(self, state: BangBangState, swing: Swing) -> tuple[BangBangState, Command]:
        """Return the motor position at the constant stiffness."""
        velocity = swing.velocity + self.lead * swing.acceleration
        has_turned = (velocity * state.velocity < 0.0) & (state.returning < 0.0)
        is_stopped = has_turned & (
            (jnp.abs(swing.deflection) <= self.tolerance) | (state.stops >= self.most_stops)
        )
        stops = has_turned & ~is_stopped
        target = jnp.where(stops, swing.position, state.target)
        returning = jnp.where(
            is_stopped, 0.0, jnp.where(state.returning >= 0.0, state.returning + swing.dt, state.returning)
        )
        share = jnp.clip(returning / self.return_time, 0.0, 1.0)
        path = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        state = BangBangState(velocity, target, state.stops + stops, returning)
        return state, Command(self.stiffness, target * (1.0 - path))
