"""One link on one spring in closed form: I q̈ + b q̇ + k q = τ with constant k and τ, underdamped."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

Value = Float[Array, "..."]


class Phase(NamedTuple):
    """Position [rad] and velocity [rad/s]."""

    position: Value
    velocity: Value


class Oscillator(NamedTuple):
    """The link.

    Args:
        inertia: I [kg·m²].
        damping: b [N·m·s/rad].
    """

    inertia: Value
    damping: Value

    def rates(self, stiffness: Value) -> tuple[Value, Value]:
        """Return the decay rate b/2I and the damped frequency √(k/I − (b/2I)²) [1/s], [rad/s]."""
        decay = self.damping / (2.0 * self.inertia)
        return decay, jnp.sqrt(stiffness / self.inertia - decay**2)

    def flow(self, phase: Phase, stiffness: Value, time: Value, torque: Value | float = 0.0) -> Phase:
        """Return where the link is `time` [s] later."""
        decay, rate = self.rates(stiffness)
        middle = torque / stiffness
        x, v = phase.position - middle, phase.velocity
        cos, sin = jnp.cos(rate * time), jnp.sin(rate * time)
        shrunk = jnp.exp(-decay * time)
        position = shrunk * (x * cos + (v + decay * x) / rate * sin)
        velocity = shrunk * (v * cos - (decay * v + stiffness / self.inertia * x) / rate * sin)
        return Phase(position + middle, velocity)

    def time_to_peak(self, phase: Phase, stiffness: Value) -> Value:
        """Return the time to the next instant of zero velocity, in (0, π/ω_d] [s]."""
        decay, rate = self.rates(stiffness)
        slope = decay * phase.velocity + stiffness / self.inertia * phase.position
        return _next(jnp.arctan2(phase.velocity * rate, slope)) / rate

    def time_to_centre(self, phase: Phase, stiffness: Value) -> Value:
        """Return the time to the next zero of the position, in (0, π/ω_d] [s]."""
        decay, rate = self.rates(stiffness)
        return _next(jnp.arctan2(-phase.position * rate, phase.velocity + decay * phase.position)) / rate


def _next(angle: Value) -> Value:
    """Return the smallest positive angle that is equal modulo π; 0 counts as a half turn."""
    wrapped = jnp.mod(angle, jnp.pi)
    return jnp.where(wrapped <= 1e-14, wrapped + jnp.pi, wrapped)
