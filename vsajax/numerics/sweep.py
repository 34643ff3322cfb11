"""Inverses of small symmetric positive definite matrices, by the sweep operator."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from vsajax.numerics.fusion import once


def inverse(matrix: Float[Array, "n n ..."]) -> Float[Array, "n n ..."]:
    """Return M⁻¹ of a symmetric positive definite matrix; lanes may follow the two axes.

    Sweeping pivot k replaces M_ij by M_ij − M_ik M_kj / M_kk off row and column k, these by M_ik / M_kk, and the
    pivot by −1 / M_kk; after all pivots −M⁻¹ is left. For a definite matrix the pivots are positive in any order,
    as those of a Cholesky factor, and diagonal scaling changes no rounding but its own. One that is not definite
    gives some finite matrix, infinity or NaN: check definiteness beforehand.

    References:
        Goodnight: A tutorial on the SWEEP operator, The American Statistician 33, 1979.
    """
    size = matrix.shape[0]
    trailing = [1] * (matrix.ndim - 2)
    for k in range(size):
        chosen = (np.arange(size) == k).astype(float).reshape(size, *trailing)
        others = 1.0 - chosen
        row = matrix[k] * others - chosen
        matrix = once(matrix * (others[:, None] * others[None]) - row[:, None] * row[None] * (1.0 / matrix[k, k]))
    return -matrix


def symmetric_part(matrix: Float[Array, "n n ..."]) -> Float[Array, "n n ..."]:
    """Return (M + Mᵀ)/2; lanes may follow the two axes."""
    return 0.5 * (matrix + jnp.swapaxes(matrix, 0, 1))
