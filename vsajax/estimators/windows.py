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


def impulse_response(
    kernel: tuple[float, ...], window: Scalar, *, sample_time: float, taps: int, quadrature: Quadrature
) -> Taps:
    """Return c with ∫₀¹ K(u) y(t + T(u − 1)) du ≈ Σ c_m y(t − m T_s) for a polynomial kernel K.

    Printed (27) has the weights T_s; for an integral over [0, 1] they are T_s/T.

    Args:
        kernel: K's coefficients of rising powers.
        window: T [s], any real number up to (taps − 1) T_s.
        sample_time: T_s [s].
        taps: length of the response.
        quadrature: "product", exact for the piecewise-linear interpolant of y and differentiable in T;
            "trapezoid" and "simpson" take the window of `taps` whole samples.
    """
    if quadrature == "product":
        return _product_weights(kernel, sample_time / window, taps)
    steps = taps - 1
    if quadrature == "simpson" and steps % 2:
        raise ValueError(f"Simpson's rule needs an even number of steps in the window; got {steps}")
    places = 1.0 - np.arange(taps) / steps
    weights = np.full(taps, 1.0 / steps)
    weights[[0, -1]] *= 0.5
    if quadrature == "simpson":
        weights = np.where(np.arange(taps) % 2, 4.0, 2.0) / (3.0 * steps)
        weights[[0, -1]] = 1.0 / (3.0 * steps)
    return jnp.asarray(weights * np.polynomial.polynomial.polyval(places, kernel))


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


def convolve(response: Taps, signals: Float[Array, "time *channels"]) -> Float[Array, "time *channels"]:
    """Return Σ_m c_m y(t − m T_s) for every sample, with zeros before the first.

    By fast Fourier transform: O(log time) a sample, whatever the length of the window.
    """
    samples = signals.shape[0]
    length = 1 << (samples + response.shape[0] - 2).bit_length()
    spectrum = jnp.fft.rfft(response, length)
    spectrum = spectrum.reshape(-1, *(1,) * (signals.ndim - 1))
    return jnp.fft.irfft(spectrum * jnp.fft.rfft(signals, length, axis=0), length, axis=0)[:samples]
