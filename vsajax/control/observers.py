"""From a joint's encoder to how it swings, and a controller together with that."""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp

from vsajax.control.base import AbstractController
from vsajax.numerics import safe_divide
from vsajax.types import Command, Sample, Scalar, Swing, optional_leaf


class DifferenceState(NamedTuple):
    """The last reading [rad], velocity [rad/s] and acceleration [rad/s²]."""

    position: Scalar
    velocity: Scalar
    acceleration: Scalar


class SwingObserver(eqx.Module):
    """Velocity by backward difference and a first-order low-pass; acceleration the same of the velocity.

    A lag of up to 30 ms at a swing of half a second helps law (23): it delays its switch to soft.

    Args:
        cutoff: corner frequency of the low-passes [Hz]; `None` for none.
    """

    cutoff: Scalar | None = eqx.field(converter=optional_leaf, default=None)

    def init(self, position: Scalar) -> DifferenceState:
        """Return the state of a joint at rest at its first reading."""
        zero = jnp.zeros_like(position)
        return DifferenceState(position, zero, zero)

    def step(
        self, state: DifferenceState, position: Scalar, motor_position: Scalar, dt: Scalar
    ) -> tuple[DifferenceState, Swing]:
        """Process a reading taken `dt` [s] after the last; return (state, swing)."""
        share = jnp.ones_like(dt) if self.cutoff is None else -jnp.expm1(-2.0 * jnp.pi * self.cutoff * dt)
        slope = safe_divide(position - state.position, dt)
        velocity = state.velocity + share * (slope - state.velocity)
        bend = safe_divide(velocity - state.velocity, dt)
        acceleration = state.acceleration + share * (bend - state.acceleration)
        swing = Swing(dt, position, velocity, acceleration, motor_position)
        return DifferenceState(position, velocity, acceleration), swing


class ObservedState(NamedTuple):
    """The states of observer and controller."""

    observer: DifferenceState
    controller: Any


class ObservedController(eqx.Module):
    """A controller that reads a joint's encoders: what runs on a robot, and what is exported.

    Args:
        controller: what to do.
        observer: how the joint swings.
    """

    controller: AbstractController
    observer: SwingObserver = eqx.field(default_factory=SwingObserver)

    def init(self, sample: Sample) -> ObservedState:
        """Return the state before the first sample, which `step` then processes as any other."""
        position, motor = sample.read("link_position"), sample.read("motor_position")
        zero = jnp.zeros_like(position)
        swing = Swing(sample.dt, position, zero, zero, motor)
        return ObservedState(self.observer.init(position), self.controller.init(swing))

    def step(self, state: ObservedState, sample: Sample) -> tuple[ObservedState, Command]:
        """Process one sample of link and motor position; return (state, command)."""
        position, motor = sample.read("link_position"), sample.read("motor_position")
        observer, swing = self.observer.step(state.observer, position, motor, sample.dt)
        controller, command = self.controller.step(state.controller, swing)
        return ObservedState(observer, controller), command
