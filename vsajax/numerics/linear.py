"""Small linear systems written out: no LAPACK, no pivoting."""

from __future__ import annotations

from collections.abc import Sequence

from vsajax.types import Scalar


def solve_definite(matrix: Sequence[Sequence[Scalar]], right: Sequence[Scalar]) -> tuple[Scalar, ...]:
    """Return x of M x = r for a symmetric positive definite M, by the factors L D Lᵀ.

    Args:
        matrix: rows of M; only the lower triangle is read.
        right: r.
    """
    size = len(right)
    lower: list[list[Scalar]] = [[] for _ in range(size)]
    inverses: list[Scalar] = []
    diagonal: list[Scalar] = []
    forward: list[Scalar] = []
    for i in range(size):
        for j in range(i):
            own = matrix[i][j]
            for k in range(j):
                own = own - lower[i][k] * lower[j][k] * diagonal[k]
            lower[i].append(own * inverses[j])
        pivot, value = matrix[i][i], right[i]
        for k in range(i):
            pivot = pivot - lower[i][k] * lower[i][k] * diagonal[k]
            value = value - lower[i][k] * forward[k]
        diagonal.append(pivot)
        inverses.append(1.0 / pivot)
        forward.append(value)
    solution = [value * inverse for value, inverse in zip(forward, inverses, strict=True)]
    for i in reversed(range(size)):
        for k in range(i + 1, size):
            solution[i] = solution[i] - lower[k][i] * solution[k]
    return tuple(solution)
