"""What an encoder's steps in the regressor take from a slope.

A fit takes its features for exact. With a deflection δ + n the features are F + F′n, and beside Σ F Fᵀ the normal
equations hold Σ E[n²] F′F′ᵀ, which pulls the coefficients by −P Σ E[n²] σ F′ with σ = F′ᵀη the stiffness at each
sample. Deflections of few counts are therefore fitted too soft, and no number of samples averages that out. Of a
reading in steps of q, E[n²] = q²/12; q is the smallest change that a reading has made.

Source: Fuller, Measurement Error Models, 1987, section 1.1, to first order, for features that are functions of one
noisy variable.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp

from vsajax.numerics import Vector, once
from vsajax.types import Scalar


class Resolution(NamedTuple):
    """A reading's last value, and the smallest change that it has made; infinite before the first."""

    last: Scalar
    step: Scalar


class Attenuation(NamedTuple):
    """What pulls a fit.

    Args:
        readings: resolutions of what the deflection is the difference of.
        pull: Σ σ̂ F′ over the samples in memory.
    """

    readings: tuple[Resolution, ...]
    pull: Vector


def start_resolution(reading: Scalar) -> Resolution:
    """Return the state before a reading has changed."""
    return Resolution(reading, jnp.full_like(reading, jnp.inf))


def resolved(state: Resolution, reading: Scalar) -> Resolution:
    """Return the state with one more reading."""
    change = jnp.abs(reading - state.last)
    return Resolution(reading, jnp.where((change > 0.0) & (change < state.step), change, state.step))


def variance_of(readings: tuple[Resolution, ...]) -> Scalar:
    """Return E[n²] of the sum or difference of readings; of one that never changed, nothing is known, and 0."""
    total = jnp.zeros(())
    for reading in readings:
        step = jnp.where(reading.step < jnp.inf, reading.step, 0.0)
        total = total + step * step
    return once(total / 12.0)
