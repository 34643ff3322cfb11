"""Small square systems by Gauss–Jordan elimination with pivoting: no LAPACK, a fixed number of operations."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float


def solve_square(matrix: Float[Array, "n n"], right: Float[Array, "n k"]) -> Float[Array, "n k"]:
    """Return M⁻¹ R of a regular matrix; one that is singular gives infinity or NaN.

    Args:
        matrix: M.
        right: R, the right-hand sides as columns.
    """
    size = matrix.shape[0]
    rows = jnp.concatenate([matrix, right], axis=1)
    order = jnp.arange(size)
    for k in range(size):
        column = jnp.where(order >= k, jnp.abs(rows[:, k]), -1.0)
        pivot = jnp.argmax(column)
        swapped = jnp.where(order == k, pivot, jnp.where(order == pivot, k, order))
        rows = rows[swapped]
        chosen = rows[k] / rows[k, k]
        rows = jnp.where((order == k)[:, None], chosen, rows - rows[:, k : k + 1] * chosen)
    return rows[:, size:]
