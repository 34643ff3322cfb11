"""Law (23) of Gasparri et al. on one link, exact to rounding: events in closed form, no integration.

Between switches the motion is that of `oscillator`. The law is stiff from the centre to the peak and soft back, so
that a swing is a way out and a way back; with equal stiffnesses it is a free oscillation.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from vsajax import rollout
from vsajax.switching.oscillator import Oscillator, Phase

Value = Float[Array, "..."]
Legs = Float[Array, " leg"]
_BISECTIONS = 60


class Exact(NamedTuple):
    """A motion as its legs, each at one stiffness and torque.

    Args:
        start: when each leg begins [s]; their number is fixed, and the last goes on for ever.
        position: there [rad].
        velocity: there [rad/s].
        stiffness: on it [N·m/rad].
        torque: from outside on it [N·m].
    """

    start: Legs
    position: Legs
    velocity: Legs
    stiffness: Legs
    torque: Legs

    @property
    def switch_times(self) -> Legs:
        """When the stiffness changes [s]; every leg but the first."""
        return self.start[1:]

    def at(self, oscillator: Oscillator, time: Value) -> tuple[Phase, Value]:
        """Return the link at any times, and the stiffness there."""
        leg = jnp.clip(jnp.searchsorted(self.start, time, side="right") - 1, 0, self.start.size - 1)
        begin = Phase(self.position[leg], self.velocity[leg])
        since = time - self.start[leg]
        return oscillator.flow(begin, self.stiffness[leg], since, self.torque[leg]), self.stiffness[leg]

    def settling_time(self, oscillator: Oscillator, band: Value) -> Value:
        """Return the last time at which |q| leaves the band [s].

        On a way back |q| falls all the way, and the exit is where it passes the band; the last way back that
        begins outside has it.
        """
        peak = jnp.abs(self.position[:-1])
        is_back = (self.position * self.velocity <= 0.0)[:-1] & (peak > band)
        low, high = jnp.zeros_like(peak), self.start[1:] - self.start[:-1]
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            begin = Phase(self.position[:-1], self.velocity[:-1])
            here = oscillator.flow(begin, self.stiffness[:-1], middle, self.torque[:-1]).position
            is_outside = jnp.abs(here) > band
            low, high = jnp.where(is_outside, middle, low), jnp.where(is_outside, high, middle)
        return jnp.max(jnp.where(is_back, self.start[:-1] + low, 0.0))


def exact_motion(
    oscillator: Oscillator,
    soft: Value,
    stiff: Value,
    *,
    impulse: Value | float = 0.0,
    pulse: tuple[Value | float, Value | float] | None = None,
    legs: int = 60,
) -> Exact:
    """Return the motion from rest under law (23); with soft = stiff, at that stiffness.

    Args:
        oscillator: the link.
        soft: k_min [N·m/rad].
        stiff: k_max [N·m/rad].
        impulse: at time 0 [N·m·s].
        pulse: torque [N·m] and duration [s] of a rectangular pulse from time 0, which must end on the way out:
            under a longer one the law slides along q̇ = 0.
        legs: how many are computed after the pulse.
    """
    zero = jnp.zeros(())
    phase = Phase(zero, zero + impulse / oscillator.inertia)
    before: list[tuple[Value, ...]] = []
    start = zero
    if pulse is not None:
        torque, duration = (zero + x for x in pulse)
        before = [(zero, *phase, zero + stiff, torque)]
        phase, start = oscillator.flow(phase, stiff, duration, torque), duration

    def leg(carry: tuple[Value, Phase], is_out: Bool[Array, ""]) -> tuple[tuple[Value, Phase], tuple[Value, ...]]:
        now, phase = carry
        stiffness = jnp.where(is_out, stiff, soft)
        time = jnp.where(
            is_out, oscillator.time_to_peak(phase, stiffness), oscillator.time_to_centre(phase, stiffness)
        )
        after = oscillator.flow(phase, stiffness, time)
        # Exactly on the switching line, so that rounding does not decide which event comes next.
        after = Phase(jnp.where(is_out, after.position, 0.0), jnp.where(is_out, 0.0, after.velocity))
        return (now + time, after), (now, *phase, stiffness, zero)

    _, rows = rollout.scan(leg, (start, phase), jnp.arange(legs) % 2 == 0)
    if before:
        rows = jax.tree.map(lambda one, many: jnp.concatenate([one[None], many]), before[0], rows)
    return Exact(*rows)


def decay_rate(oscillator: Oscillator, soft: Value, stiff: Value) -> Value:
    """Return the amplitude's decay rate under law (23) [1/s]; with soft = stiff it is b/2I."""
    zero = jnp.zeros(())
    phase = Phase(zero, zero + 1.0)
    out = oscillator.time_to_peak(phase, stiff)
    peak = oscillator.flow(phase, stiff, out)._replace(velocity=zero)
    back = oscillator.time_to_centre(peak, soft)
    return -jnp.log(jnp.abs(oscillator.flow(peak, soft, back).velocity)) / (out + back)
