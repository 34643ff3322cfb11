"""Eigenvalues of small symmetric matrices by Jacobi rotations, and functions of them with their derivatives."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from vsajax import numerics, rollout
from vsajax.types import Scalar

Matrix = Float[Array, "m m"]
Lanes = Float[Array, "m m ..."]

_SWEEPS = 8
"""Convergence is quadratic: 6 × 6 matrices need five or six sweeps to the last digit."""


@jax.custom_jvp
def inverse(matrix: Matrix) -> Matrix:
    """Return the inverse of a symmetric positive definite matrix, see `numerics.inverse`."""
    return numerics.lanes_last(numerics.inverse)(matrix)


@inverse.defjvp
def _inverse_jvp(primals: tuple[Matrix], tangents: tuple[Matrix]) -> tuple[Matrix, Matrix]:
    result = inverse(*primals)
    return result, -result @ tangents[0] @ result


def eigen(matrix: Matrix) -> tuple[Float[Array, " m"], Matrix]:
    """Return eigenvalues, in no order, and eigenvectors as columns, of a symmetric matrix.

    Disjoint pairs are rotated at once, and the indices turned between rounds so that all pairs meet in a sweep
    (Brent and Luk). The number of operations is fixed. Not differentiable by itself; its users are.
    """
    if matrix.shape[0] == 1:
        return matrix[0], jnp.ones_like(matrix)
    return numerics.lanes_last(_eigen)(jax.lax.stop_gradient(matrix))


def _eigen(matrix: Lanes) -> tuple[Float[Array, "m ..."], Lanes]:
    size = matrix.shape[0]
    turn = _turned(size)
    rounds = size - 1 if size % 2 == 0 else size

    def one_round(state: tuple[Lanes, Lanes]) -> tuple[Lanes, Lanes]:
        matrix, vectors = state
        cosine, sine = _angles(matrix)
        matrix = numerics.once(jnp.swapaxes(_rotated(matrix, cosine, sine), 0, 1))
        # Vectors are kept as rows: both are rotated in their first axis.
        matrix, vectors = numerics.once((_rotated(matrix, cosine, sine), _rotated(vectors, cosine, sine)))
        return numerics.once((matrix[turn][:, turn], vectors[turn]))

    start = (matrix, jnp.broadcast_to(numerics.identity_like(matrix), matrix.shape))
    matrix, vectors = rollout.repeat(one_round, start, times=rounds * _SWEEPS)
    diagonal = (matrix * numerics.identity_like(matrix)).sum(1)
    return diagonal, jnp.swapaxes(vectors, 0, 1)


def _turned(size: int) -> np.ndarray:
    """Return where each index comes from in the next round: pairs are (0, 1), (2, 3), …; an odd last one rests."""
    if size == 2:
        return np.array([0, 1])
    # The round-robin of a tournament: for an even number the first stays, the others go round.
    seats = [*range(0, size - 1, 2), *([size - 1] if size % 2 else []), *reversed(range(1, size, 2))]
    fixed = 1 - size % 2
    circle = seats[fixed:]
    moved = seats[:fixed] + circle[-1:] + circle[:-1]
    source = np.empty(size, int)
    source[seats] = moved
    return source


def _angles(matrix: Lanes) -> tuple[Float[Array, "pairs ..."], Float[Array, "pairs ..."]]:
    """Return cosine and sine that annul the entries (2k, 2k + 1)."""
    even = range(0, matrix.shape[0] - 1, 2)
    left = jnp.stack([matrix[i, i] for i in even])
    right = jnp.stack([matrix[i + 1, i + 1] for i in even])
    off = jnp.stack([matrix[i, i + 1] for i in even])
    difference = right - left
    # tan of the smaller angle, 2 a / (d ± √(d² + 4a²)): safe for any d and a, and 0 where both vanish.
    root = jnp.sqrt(difference * difference + 4.0 * off * off)
    signed = difference + jnp.where(difference < 0.0, -root, root)
    tangent = numerics.safe_divide(2.0 * off, signed)
    cosine = 1.0 / jnp.sqrt(1.0 + tangent * tangent)
    return numerics.once((cosine, tangent * cosine))


def _rotated(matrix: Lanes, cosine: Float[Array, "pairs ..."], sine: Float[Array, "pairs ..."]) -> Lanes:
    """Return the matrix with its rows 2k and 2k + 1 rotated."""
    rows = []
    for k in range(matrix.shape[0] // 2):
        first, second = matrix[2 * k], matrix[2 * k + 1]
        rows += [cosine[k] * first - sine[k] * second, sine[k] * first + cosine[k] * second]
    return jnp.stack([*rows, *matrix[2 * len(range(matrix.shape[0] // 2)) :]])


@jax.custom_jvp
def floored(matrix: Matrix, floor: Scalar) -> Matrix:
    """Return the symmetric matrix with every eigenvalue below `floor` raised to it: V max(Λ, floor) Vᵀ.

    It is the nearest in Frobenius norm of those whose eigenvalues are all at least `floor` (Higham). Its
    derivative is exact by the formula of Daleckii and Krein, also where eigenvalues coincide; on the kink λ =
    floor it is that from above.
    """
    return _floored(matrix, floor)[0]


def _floored(matrix: Matrix, floor: Scalar) -> tuple[Matrix, Float[Array, " m"], Matrix]:
    values, vectors = eigen(matrix)
    return _compose(vectors, jnp.maximum(values, floor)), values, vectors


def _compose(vectors: Matrix, values: Float[Array, " m"]) -> Matrix:
    return numerics.symmetric_part((vectors * values) @ vectors.T)


@floored.defjvp
def _floored_jvp(primals: tuple[Matrix, Scalar], tangents: tuple[Matrix, Scalar]) -> tuple[Matrix, Matrix]:
    (matrix, floor), (change, floor_change) = primals, tangents
    result, values, vectors = _floored(matrix, floor)
    above = values >= floor
    over = jnp.maximum(values - floor, 0.0)
    # (f(a) − f(b)) / (a − b) of f = max(·, floor): 1 between two above, 0 between two below, else the share above.
    mixed = numerics.safe_divide(jnp.abs(over[:, None] - over), jnp.abs(values[:, None] - values))
    slope = jnp.where(above[:, None] & above, 1.0, jnp.where(above[:, None] | above, mixed, 0.0))
    inside = vectors.T @ numerics.symmetric_part(change) @ vectors
    raised = _compose(vectors, jnp.where(above, 0.0, floor_change))
    return result, numerics.symmetric_part(vectors @ (slope * inside) @ vectors.T) + raised


@jax.custom_jvp
def largest_eigenvalue(matrix: Matrix) -> Scalar:
    """Return the largest eigenvalue; its derivative is vᵀ dM v."""
    return eigen(matrix)[0].max()


@largest_eigenvalue.defjvp
def _largest_jvp(primals: tuple[Matrix], tangents: tuple[Matrix]) -> tuple[Scalar, Scalar]:
    values, vectors = eigen(*primals)
    top = jnp.take(vectors, jnp.argmax(values), axis=1)
    return values.max(), top @ tangents[0] @ top


def smallest_eigenvalue(matrix: Matrix) -> Scalar:
    """Return the smallest eigenvalue; its derivative is vᵀ dM v."""
    return -largest_eigenvalue(-matrix)


@jax.custom_jvp
def largest_generalised_eigenvalue(matrix: Matrix, metric: Matrix) -> Scalar:
    """Return the largest λ with M v = λ N v, N symmetric positive definite; NaN where N is not.

    With vᵀ N v = 1 its derivative is vᵀ (dM − λ dN) v.
    """
    return _generalised(matrix, metric)[0]


def _generalised(matrix: Matrix, metric: Matrix) -> tuple[Scalar, Float[Array, " m"]]:
    scales, axes = eigen(metric)
    root = axes / jnp.sqrt(scales)
    values, vectors = eigen(numerics.symmetric_part(root.T @ matrix @ root))
    best = jnp.argmax(values)
    defined = jnp.where((scales > 0.0).all(), 0.0, jnp.nan)
    return values[best] + defined, root @ jnp.take(vectors, best, axis=1)


@largest_generalised_eigenvalue.defjvp
def _generalised_jvp(primals: tuple[Matrix, Matrix], tangents: tuple[Matrix, Matrix]) -> tuple[Scalar, Scalar]:
    value, vector = _generalised(*primals)
    return value, vector @ (tangents[0] - value * tangents[1]) @ vector
