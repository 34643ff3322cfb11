"""Controllers that damp by moving the motor at a constant stiffness: PID, and bang-bang with bring-back."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp

from vsajax.control.base import AbstractController
from vsajax.types import Command, Scalar, Swing, as_leaf


class PIDState(NamedTuple):
    """The integral of the link's position [rad·s]."""

    integral: Scalar


class PIDPosition(AbstractController):
    """θ = −(Kp q + Ki ∫q + Kd q̇), both the integral and θ limited.

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

    def init(self, swing: Swing) -> PIDState:
        """Return the state before the first instant."""
        return PIDState(jnp.zeros_like(swing.position))

    def step(self, state: PIDState, swing: Swing) -> tuple[PIDState, Command]:
        """Return the motor position at the constant stiffness."""
        limit = self.longest_integral
        integral = jnp.clip(state.integral + swing.position * swing.dt, -limit, limit)
        wanted = self.proportional * swing.position + self.integral * integral + self.derivative * swing.velocity
        return PIDState(integral), Command(self.stiffness, jnp.clip(-wanted, -self.reach, self.reach))


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
