"""Measuring a position inside a control loop, sample by sample."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp

from vsajax.sensing.sensors import Encoder
from vsajax.types import Scalar, optional_leaf


class FeedbackState(NamedTuple):
    """The last positions, newest first [rad]; empty without a delay."""

    past: tuple[Scalar, ...]


class FeedbackSensor(eqx.Module):
    """A position sensor in a control loop: delay, noise, encoder.

    The noise is drawn beforehand, so that no random number is drawn inside a loop.

    Args:
        noise_std: [rad].
        encoder: the quantisation, or `None`.
        delay: of the whole loop, any real number [s].
        longest_delay: samples that are kept; delays beyond them are cut.
    """

    noise_std: Scalar | None = eqx.field(converter=optional_leaf, default=None)
    encoder: Encoder | None = None
    delay: Scalar | None = eqx.field(converter=optional_leaf, default=None)
    longest_delay: int = eqx.field(static=True, default=20)

    def init(self, position: Scalar) -> FeedbackState:
        """Return the state of a joint that had been at `position` for long."""
        return FeedbackState(() if self.delay is None else (position,) * (self.longest_delay + 1))

    def step(
        self, state: FeedbackState, position: Scalar, noise: Scalar | None, sample_time: Scalar
    ) -> tuple[FeedbackState, Scalar]:
        """Return (state, reading) of a position [rad]; `noise` is a standard normal number."""
        reading = position
        if self.delay is not None:
            state = FeedbackState((position, *state.past[:-1]))
            delay = jnp.clip(self.delay / sample_time, 0.0, float(self.longest_delay))
            reading = jnp.zeros_like(position)
            for age, past in enumerate(state.past):
                reading = reading + jnp.maximum(1.0 - jnp.abs(delay - age), 0.0) * past
        if self.noise_std is not None and noise is not None:
            reading = reading + self.noise_std * noise
        return state, reading if self.encoder is None else self.encoder(reading)
