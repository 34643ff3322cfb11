"""From what is true to what is measured: delay, bias, noise, quantisation; and the sampling clock."""

from __future__ import annotations

from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Key

from vsajax.types import Scalar, Series, as_leaf, optional_leaf

Rounding = Literal["nearest", "floor"]


class Encoder(eqx.Module):
    """Quantisation to 2π / counts_per_revolution.

    Args:
        counts_per_revolution: Δ.
        offset: where the counts' zero lies [rad]; it shifts the readings.
        rounding: "nearest", or "floor" as counters that only count edges do.
    """

    counts_per_revolution: Scalar = eqx.field(converter=as_leaf)
    offset: Scalar | None = eqx.field(converter=optional_leaf, default=None)
    rounding: Rounding = eqx.field(static=True, default="nearest")

    def __call__(self, position: Float[Array, "..."]) -> Float[Array, "..."]:
        """Return the reading of `position` [rad]."""
        count = 2.0 * jnp.pi / self.counts_per_revolution
        shifted = position if self.offset is None else position + self.offset
        whole = jnp.round if self.rounding == "nearest" else jnp.floor
        return whole(shifted / count) * count


class Sensor(eqx.Module):
    """One measured signal: true value -> delayed -> + bias + Gaussian noise -> quantised.

    Every effect may be `None`: it is then absent from the compiled program, and a signal without noise is
    computed once for all noise draws.

    Args:
        delay: [s]; the signal is held at its first value before it.
        gain: reading per true value, e.g. of a torque constant that is off; it acts before the bias.
        bias: [unit of the signal].
        noise_std: [unit of the signal].
        encoder: the quantisation, or `None`.
    """

    delay: Scalar | None = eqx.field(converter=optional_leaf, default=None)
    gain: Scalar | None = eqx.field(converter=optional_leaf, default=None)
    bias: Scalar | None = eqx.field(converter=optional_leaf, default=None)
    noise_std: Scalar | None = eqx.field(converter=optional_leaf, default=None)
    encoder: Encoder | None = None

    def __call__(self, time: Series, signal: Series, *, key: Key[Array, ""]) -> Series:
        """Return what the sensor reads of `signal` at `time` [s]."""
        if self.delay is not None:
            signal = jnp.interp(time - self.delay, time, signal)
        if self.gain is not None:
            signal = self.gain * signal
        if self.bias is not None:
            signal = signal + self.bias
        if self.noise_std is not None:
            signal = signal + self.noise_std * jax.random.normal(key, signal.shape, signal.dtype)
        return signal if self.encoder is None else self.encoder(signal)


class Clock(eqx.Module):
    """When samples are taken.

    Args:
        sample_time: T [s].
        duration: of the recording [s]; it holds duration/T + 1 samples.
        jitter_std: standard deviation of each instant about its place [s], cut at ±0.45 T so that instants
            never cross; `None` for a regular clock.
    """

    sample_time: float = eqx.field(static=True)
    duration: float = eqx.field(static=True)
    jitter_std: Scalar | None = eqx.field(converter=optional_leaf, default=None)

    @property
    def samples(self) -> int:
        """Number of samples."""
        return round(self.duration / self.sample_time) + 1

    def times(self, *, key: Key[Array, ""]) -> Series:
        """Return the sampling instants [s]; the first is 0."""
        regular = jnp.arange(self.samples) * self.sample_time
        if self.jitter_std is None:
            return regular
        limit = 0.45 * self.sample_time
        jitter = jnp.clip(self.jitter_std * jax.random.normal(key, regular.shape), -limit, limit)
        return regular + jitter.at[0].set(0.0)

    def intervals(self, time: Series) -> Float[Array, "..."]:
        """Return T for a regular clock, else the intervals between `time`."""
        return jnp.asarray(self.sample_time) if self.jitter_std is None else jnp.diff(time)
