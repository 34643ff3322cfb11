"""Smooth functions that stay finite, in value and derivative, where the textbook form does not."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Value = Float[Array, "..."]


@jax.custom_jvp
def with_slope(value: Value, slope: Value, variable: Value) -> Value:
    """Return `value`, whose derivative gains `slope` · d`variable`: for what is known in closed form.

    `value` must not depend on `variable` otherwise.

    Raises:
        TypeError: of a second derivative: `slope` was computed for the first one and has none of its own.
    """
    return value


@with_slope.defjvp
def _with_slope_jvp(
    primals: tuple[Value, Value, Value], tangents: tuple[Value, Value, Value]
) -> tuple[Value, Value]:
    value, slope, _ = primals
    value_tangent, _, variable_tangent = tangents
    return value, value_tangent + _final(slope) * variable_tangent


@jax.custom_jvp
def _final(slope: Value) -> Value:
    """Return a derivative that cannot be differentiated again."""
    return slope


@_final.defjvp
def _final_jvp(primals: tuple[Value], tangents: tuple[Value]) -> tuple[Value, Value]:
    raise TypeError(
        "a derivative that is known in closed form, such as that of an estimate by its prior scale, has none "
        "of its own: take first derivatives only, or finite differences of them"
    )


def safe_divide(numerator: Value, denominator: Value) -> Value:
    """Return numerator / denominator, and 0 with zero derivative where the denominator is 0."""
    is_zero = denominator == 0.0
    return jnp.where(is_zero, 0.0, numerator / jnp.where(is_zero, 1.0, denominator))


def safe_sqrt(x: Value) -> Value:
    """Return √x for x > 0 and 0 elsewhere, with finite derivatives everywhere: 0 at 0."""
    is_positive = x > 0.0
    return jnp.where(is_positive, jnp.sqrt(jnp.where(is_positive, x, 1.0)), 0.0)


def logistic(x: Value) -> Value:
    """Return 1 / (1 + eˣ), without overflow for any x."""
    return 0.5 - 0.5 * jnp.tanh(0.5 * x)


def smooth_sign(velocity: Value, scale: Value) -> Value:
    """Return tanh(velocity / scale): the sign of a velocity, smoothed over ±scale [the unit of velocity]."""
    return jnp.tanh(velocity / scale)


def damped_response(rate: Value, step: Value) -> tuple[Value, Value, Value]:
    """Return the exact response of x' = v, v' = −λ v + a over a step h with constant a.

    The three numbers d, g, w of v(h) = d v + g a and x(h) = x + g v + w a are
    d = e^(−λh), g = (1 − e^(−λh))/λ → h and w = (h − g)/λ → h²/2 as λ → 0, exact there too.

    Args:
        rate: λ ≥ 0 [1/s].
        step: h [s].
    """
    x = rate * step
    is_small = x < 1e-2
    safe = jnp.where(is_small, 1.0, x)
    first = 1.0 - x * (1 / 2 - x * (1 / 6 - x * (1 / 24 - x * (1 / 120 - x * (1 / 720 - x / 5040)))))
    second = 1 / 2 - x * (1 / 6 - x * (1 / 24 - x * (1 / 120 - x * (1 / 720 - x / 5040))))
    first = jnp.where(is_small, first, -jnp.expm1(-safe) / safe)
    second = jnp.where(is_small, second, (safe + jnp.expm1(-safe)) / (safe * safe))
    return jnp.exp(-x), step * first, step * step * second
