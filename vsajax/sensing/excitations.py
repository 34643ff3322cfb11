"""Torque profiles that drive a joint, as functions of time."""

from __future__ import annotations

from abc import abstractmethod

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from vsajax import numerics
from vsajax.types import Scalar, Series, as_leaf

Value = Float[Array, "..."]


class AbstractExcitation(eqx.Module):
    """A torque as a function of time."""

    @abstractmethod
    def __call__(self, time: Value) -> Value:
        """Return the torque at `time` [s], in N·m."""


class Sine(AbstractExcitation):
    """offset + amplitude · sin(2π frequency t + phase).

    Args:
        amplitude: [N·m].
        frequency: [Hz].
        phase: [rad].
        offset: [N·m].
    """

    amplitude: Scalar = eqx.field(converter=as_leaf, default=0.0)
    frequency: Scalar = eqx.field(converter=as_leaf, default=0.0)
    phase: Scalar = eqx.field(converter=as_leaf, default=0.0)
    offset: Scalar = eqx.field(converter=as_leaf, default=0.0)

    def __call__(self, time: Value) -> Value:
        """Return the torque at `time`."""
        return self.offset + self.amplitude * _sine(self.frequency * time, self.phase)


class Multisine(AbstractExcitation):
    """offset + Σ amplitudeᵢ · sin(2π frequencyᵢ t + phaseᵢ).

    Args:
        amplitudes: [N·m].
        frequencies: [Hz], as many.
        phases: [rad], as many.
        offset: [N·m].
    """

    amplitudes: Float[Array, " tones"] = eqx.field(converter=as_leaf)
    frequencies: Float[Array, " tones"] = eqx.field(converter=as_leaf)
    phases: Float[Array, " tones"] = eqx.field(converter=as_leaf)
    offset: Scalar = eqx.field(converter=as_leaf, default=0.0)

    def __call__(self, time: Value) -> Value:
        """Return the torque at `time`."""
        # A loop over tones, not a (time, tones) table: a tone costs no memory.
        total = self.offset * jnp.ones_like(time)
        for i in range(self.amplitudes.shape[0]):
            total = total + self.amplitudes[i] * _sine(self.frequencies[i] * time, self.phases[i])
        return total


class Chirp(AbstractExcitation):
    """A sine whose frequency rises linearly from `start` to `stop` over `duration`, and again after it.

    Args:
        amplitude: [N·m].
        start: [Hz].
        stop: [Hz].
        duration: [s].
        offset: [N·m].
    """

    amplitude: Scalar = eqx.field(converter=as_leaf)
    start: Scalar = eqx.field(converter=as_leaf)
    stop: Scalar = eqx.field(converter=as_leaf)
    duration: Scalar = eqx.field(converter=as_leaf)
    offset: Scalar = eqx.field(converter=as_leaf, default=0.0)

    def __call__(self, time: Value) -> Value:
        """Return the torque at `time`."""
        elapsed = jnp.mod(time, self.duration)
        cycles = self.start * elapsed + 0.5 * (self.stop - self.start) / self.duration * elapsed**2
        return self.offset + self.amplitude * _sine(cycles, 0.0)


class BandLimitedNoise(AbstractExcitation):
    """Gaussian noise between two frequencies: a sum of tones of equal power, random in phase and frequency.

    Each tone lies at random in its own equal share of the band, so that the signal does not repeat.

    Args:
        std: [N·m].
        low: lower edge of the band [Hz].
        high: upper edge [Hz].
        offset: [N·m].
        seed: of the phases and frequencies; the same seed gives the same signal.
        tones: how many; 32 are Gaussian to a few percent.
    """

    std: Scalar = eqx.field(converter=as_leaf)
    low: Scalar = eqx.field(converter=as_leaf)
    high: Scalar = eqx.field(converter=as_leaf)
    offset: Scalar = eqx.field(converter=as_leaf, default=0.0)
    seed: int = eqx.field(static=True, default=0)
    tones: int = eqx.field(static=True, default=32)

    def __call__(self, time: Value) -> Value:
        """Return the torque at `time`."""
        places, turns = jax.random.uniform(jax.random.key(self.seed), (2, self.tones), time.dtype)
        shares = (jnp.arange(self.tones) + places) / self.tones
        amplitude = self.std * jnp.sqrt(2.0 / self.tones)
        tones = Multisine(
            amplitudes=jnp.broadcast_to(amplitude, (self.tones,)),
            frequencies=self.low + shares * (self.high - self.low),
            phases=2.0 * jnp.pi * turns,
            offset=self.offset,
        )
        return tones(time)


class Recorded(AbstractExcitation):
    """A recorded torque, interpolated linearly and held at its ends.

    Args:
        time: strictly increasing [s].
        torque: [N·m].
    """

    time: Series = eqx.field(converter=as_leaf)
    torque: Series = eqx.field(converter=as_leaf)

    def __call__(self, time: Value) -> Value:
        """Return the torque at `time`."""
        return jnp.interp(time, self.time, self.torque)


class Excitation(eqx.Module):
    """What drives each input of a joint; `None` is no torque.

    Args:
        motor: on the principal motor's axis.
        setpoint_motor: on the stiffness-setting motor's axis.
        external: from the environment, on the link.
        motor1: on the axis of an antagonistic pair's first motor.
        motor2: on the axis of its second motor.
    """

    motor: AbstractExcitation | None = None
    setpoint_motor: AbstractExcitation | None = None
    external: AbstractExcitation | None = None
    motor1: AbstractExcitation | None = None
    motor2: AbstractExcitation | None = None

    def torques(self, time: Value) -> tuple[Value, ...]:
        """Return the torques at `time` in the order of the fields [N·m]."""
        inputs = (self.motor, self.setpoint_motor, self.external, self.motor1, self.motor2)
        return tuple(jnp.zeros_like(time) if torque is None else torque(time) for torque in inputs)


def _sine(turns: Value, phase: Scalar | float) -> Value:
    """Return sin(2π turns + phase). Whole turns are dropped first, exactly, so that no angle grows with time."""
    return numerics.sin(2.0 * jnp.pi * (turns - jnp.round(turns)) + phase)
