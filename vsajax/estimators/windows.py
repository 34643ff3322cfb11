"""Integrals over a moving window as finite impulse responses.

Notation of Ménard, Grioli, Bicchi: u ∈ [0, 1] runs from the oldest instant of the window (t − T) to the newest,
and g(u) = u³(1 − u)³/6 vanishes with g′ and g″ at both ends. Tap m of a filter weights the sample m steps before
the newest, at u_m = 1 − m T_s/T.
"""

from __future__ import annotations

import math
from typing import Literal

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from vsajax.types import Scalar

Quadrature = Literal["product", "trapezoid", "simpson"]
Taps = Float[Array, " taps"]

# Coefficients of rising powers of u.
FIRST = (0.0, 0.0, 0.5, -2.0, 2.5, -1.0)
"""g′."""
SECOND = (0.0, 1.0, -6.0, 10.0, -5.0)
"""g″."""
THIRD = (1.0, -12.0, 30.0, -20.0)
"""g‴."""
FIRST_NORM = math.sqrt(1.0 / 27720.0)
"""The root of ∫ g′² du, the noise gain of g′."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)


def taps_of(window: float, sample_time: float) -> int:
    """Return how many taps cover a window of `window` [s]."""
    return math.ceil(window / sample_time - 1e-9) + 1


def span_of(window: Scalar, *, sample_time: float, quadrature: Quadrature) -> Scalar:
    """Return the window that a quadrature covers [s].

    It is T itself with "product"; with "trapezoid" the whole number of samples within T, and with "simpson" the
    even number of them, whose derivatives in T are 0.
    """
    if quadrature == "product":
        return window
    block = sample_time * (2 if quadrature == "simpson" else 1)
    # The margin absorbs rounding of T/T_s.
    return block * jnp.maximum(jnp.floor(window / block + 1e-6), 1.0)


def impulse_response(
    kernel: tuple[float, ...], window: Scalar, *, sample_time: float, taps: int, quadrature: Quadrature
) -> Taps:
    """Return c with ∫₀¹ K(u) y(t + T(u − 1)) du ≈ Σ c_m y(t − m T_s) for a polynomial kernel K.

    Printed (27) has the weights T_s; for an integral over [0, 1] they are T_s/T.

    Args:
        kernel: K's coefficients of rising powers.
        window: T [s], any real number up to (taps − 1) T_s that is a `span_of` the quadrature.
        sample_time: T_s [s].
        taps: length of the response.
        quadrature: "product", exact for the piecewise-linear interpolant of y and differentiable in T;
            "trapezoid"; or "simpson".
    """
    if quadrature == "product":
        return _product_weights(kernel, sample_time / window, taps)
    places = 1.0 - jnp.arange(taps) * (sample_time / window)
    index, steps = jnp.arange(taps), jnp.round(window / sample_time)
    is_end = (index == 0) | (index == steps)
    if quadrature == "simpson":
        weights = jnp.where(is_end, 1.0, jnp.where(index % 2 == 1, 4.0, 2.0)) / 3.0
    else:
        weights = jnp.where(is_end, 0.5, 1.0)
    weights = jnp.where(index <= steps, weights / steps, 0.0)
    return weights * _polynomial(kernel, places)


def _product_weights(kernel: tuple[float, ...], step: Scalar, taps: int) -> Taps:
    """Integrate the kernel against the hat functions of the samples, each cut at the ends of the window.

    Four Gauss–Legendre nodes a cell are exact: kernel times hat is of degree 6 at most.
    """
    newer = 1.0 - jnp.arange(taps) * step
    older = newer - step
    low, high = jnp.clip(older, 0.0, 1.0), jnp.clip(newer, 0.0, 1.0)
    half = 0.5 * (high - low)
    # One cell a row, from the sample u_m down to u_(m+1).
    nodes = (0.5 * (high + low))[:, None] + half[:, None] * _NODES
    values = half[:, None] * _WEIGHTS * _polynomial(kernel, nodes)
    share = (nodes - older[:, None]) / step
    own = jnp.sum(values * share, axis=1)
    passed_on = jnp.sum(values * (1.0 - share), axis=1)
    return own + jnp.concatenate([jnp.zeros_like(passed_on[:1]), passed_on[:-1]])


def _polynomial(coefficients: tuple[float, ...], x: Array) -> Array:
    total = jnp.full_like(x, coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        total = total * x + coefficient
    return total


def convolve(responses: tuple[Taps, ...], signals: tuple[Float[Array, " time"], ...]) -> Float[Array, " time"]:
    """Return Σᵢ Σ_m cᵢ_m yᵢ(t − m T_s) for every sample, with zeros before the first.

    By fast Fourier transform: O(log time) a sample, whatever the length of the window.
    """
    samples, taps = signals[0].shape[0], responses[0].shape[0]
    length = _fast_length(samples + taps - 1)
    pairs = zip(responses, signals, strict=True)
    spectrum = sum(jnp.fft.rfft(response, length) * jnp.fft.rfft(signal, length) for response, signal in pairs)
    return jnp.fft.irfft(spectrum, length)[:samples]


def _fast_length(least: int) -> int:
    """Return the shortest even length from `least` on that has no prime factor above 5."""
    powers = (3**i * 5**j for i in range(12) for j in range(8))
    return min(odd << max(1, (-(-least // odd) - 1).bit_length()) for odd in powers if odd < 2 * least)
