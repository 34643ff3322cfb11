"""Small symmetric matrices as tuples of rows, vectors as tuples of scalars.

Under `vmap` every operation here is elementwise over lanes. With d = 18 this runs several times faster than
`@` or `einsum`, whose reductions XLA does not vectorise over lanes on CPU; sums are therefore written out.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
from jaxtyping import Array, Float

from vsajax.types import Scalar

Rows = tuple[Float[Array, " d"], ...]
Vector = Sequence[Scalar]


def scaled_identity(scale: Scalar, size: int) -> Rows:
    """Return scale · I as rows."""
    return tuple(scale * row for row in jnp.eye(size, dtype=scale.dtype))


def combine_rows(rows: Rows, weights: Vector) -> Float[Array, " d"]:
    """Return Σ wᵢ rowᵢ, which for a symmetric matrix is its product with the vector of weights."""
    total = weights[0] * rows[0]
    for weight, row in zip(weights[1:], rows[1:], strict=True):
        total = total + weight * row
    return total


def dot(left: Vector, right: Vector) -> Scalar:
    """Return Σ leftᵢ rightᵢ."""
    total = left[0] * right[0]
    for a, b in zip(left[1:], right[1:], strict=True):
        total = total + a * b
    return total


def rank_one_downdate(rows: Rows, vector: Float[Array, " d"], weight: Scalar) -> Rows:
    """Return M − weight · v vᵀ."""
    scaled = weight * vector
    return tuple(row - scaled[i] * vector for i, row in enumerate(rows))


def scaled_symmetric_part(rows: Rows, scale: Scalar) -> Rows:
    """Return scale · (M + Mᵀ)/2, for recursions that would otherwise magnify the asymmetry of rounding."""
    matrix = jnp.stack(rows)
    return tuple(0.5 * scale * (matrix + matrix.T))
