"""The fastest damping by switching: law (23) with a delayed release, without friction, in closed form.

Law (23) switches to soft at the peak. Stiff for a phase δ past it, the link has turned and is on its way back with
some speed; half a swing takes the energy times s = sin²δ + (k_min/k_max) cos²δ in the time
(π/2 + δ)/ω_max + atan2(√(k_min/k_max) cos δ, sin δ)/ω_min. It costs energy and saves time, and to first order in δ
only saves: law (23) is an extremal of the energy at a given time, not the fastest decay.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Value = Float[Array, "..."]
_BISECTIONS = 60


def release_rate(ratio: Value, delay: Value) -> Value:
    """Return the energy's decay rate, in units of √(k_min/I), released a phase after the peak.

    Args:
        ratio: k_min/k_max in (0, 1).
        delay: δ, phase of the stiff oscillation past the peak [rad]; 0 is law (23).
    """
    root = jnp.sqrt(ratio)
    kept = jnp.sin(delay) ** 2 + ratio * jnp.cos(delay) ** 2
    back = jnp.arctan2(root * jnp.cos(delay), jnp.sin(delay))
    return -jnp.log(kept) / (root * (0.5 * jnp.pi + delay) + back)


def best_release(ratio: Value) -> Value:
    """Return the phase past the peak at which to release that makes the energy decay fastest [rad].

    As a share of the way out it is `best_release(ratio) / (π/2)`, what `control.DelayedRelease` takes.
    """
    slope = jax.grad(release_rate, argnums=1)
    low, high = jnp.zeros_like(ratio), jnp.full_like(ratio, 0.45 * jnp.pi)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        rises = slope(ratio, middle) > 0.0
        low, high = jnp.where(rises, middle, low), jnp.where(rises, high, middle)
    return 0.5 * (low + high)
