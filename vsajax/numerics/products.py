"""Products of small vectors and symmetric matrices in the loop over samples.

Under `vmap` neighbouring lanes are neighbours in memory (`lanes_minor`), and every operation is elementwise over
them, sums included (`sum_of_products`): with d = 18 least squares runs several times faster than with `@` or
`einsum`, whose reductions XLA does not vectorise over lanes on CPU.
"""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from vsajax.numerics.fusion import once
from vsajax.numerics.lanes import lanes_minor
from vsajax.numerics.sums import sum_of_products
from vsajax.types import Scalar

Vector = Float[Array, " d"]
Matrix = Float[Array, "d d"]


def dot(left: Vector, right: Vector) -> Scalar:
    """Return Σ leftᵢ rightᵢ.

    Raises:
        ValueError: unequal lengths.
    """
    _require_equal(left.shape[0], right.shape[0])
    return sum_of_products(left, right)


def symmetric_product(matrix: Matrix, vector: Vector) -> Vector:
    """Return M v of a symmetric M, as Σ vᵢ rowᵢ.

    Raises:
        ValueError: unequal sizes.
    """
    _require_equal(matrix.shape[0], vector.shape[0])
    return once(lanes_minor(sum_of_products(lanes_minor(vector[:, None]), matrix)))


def rank_one_downdate(matrix: Matrix, vector: Vector, weight: Scalar) -> Matrix:
    """Return M − weight · v vᵀ."""
    scaled = once(lanes_minor(weight * vector))
    return lanes_minor(matrix - scaled[:, None] * vector[None, :])


def scaled_symmetric_part(matrix: Matrix, scale: Scalar) -> Matrix:
    """Return scale · (M + Mᵀ)/2, for recursions that would otherwise magnify the asymmetry of rounding."""
    return lanes_minor(0.5 * scale * (matrix + matrix.T))


def trace(matrix: Matrix) -> Scalar:
    """Return tr(M)."""
    size = matrix.shape[0]
    diagonal = [jax.lax.slice(matrix, (i, i), (i + 1, i + 1)) for i in range(size)]
    return jnp.squeeze(functools.reduce(lambda total, entry: total + entry, diagonal))


def sum_of_squares(matrix: Matrix) -> Scalar:
    """Return the sum of the squares of all entries, which is tr(M²) of a symmetric M."""
    columns = sum_of_products(matrix, matrix)
    return dot(columns, jnp.ones_like(columns))


def _require_equal(size: int, other: int) -> None:
    if size != other:
        raise ValueError(f"products need equal sizes; got {size} and {other}")
