"""Torque as a smooth curve of the deflection, and of the set-point where one moves: what faults are judged by."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

_MOST = 20_000
"""Samples that a curve is judged by; of longer logs every n-th is taken."""


def powers(values: np.ndarray, highest: int, *, lowest: int = 0) -> list[np.ndarray]:
    """Return powers of values that are brought to −1 … 1; they span what powers of the values themselves do."""
    low, high = float(values.min()), float(values.max())
    scaled = 2.0 * (values - low) / (high - low) - 1.0 if high > low else np.zeros_like(values)
    return [scaled**power for power in range(lowest, highest + 1)]


def curve_of(deflection: np.ndarray, setpoint: np.ndarray | None = None, *, order: int = 5) -> list[np.ndarray]:
    """Return features whose sums are the smooth curves of a deflection.

    Args:
        deflection: [rad].
        setpoint: moves the curve, where it moves at all.
        order: highest power of the deflection.

    Returns:
        The constant first, then powers, times those of the set-point up to its square.
    """
    own = powers(deflection, order)
    if setpoint is None or not np.ptp(setpoint) > 0.0:
        return own
    return [one * two for two in powers(setpoint, 2) for one in own]


def solve(matrix: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return the least-squares coefficients of the columns of a matrix, `(sample, feature)`.

    By the normal equations: the features are few, and between −1 and 1. A million samples need no decomposition.
    """
    return np.linalg.lstsq(matrix.T @ matrix, matrix.T @ target, rcond=1e-12)[0]


def fit(features: Sequence[np.ndarray], target: np.ndarray, chosen: np.ndarray | None = None) -> np.ndarray:
    """Return what a least-squares fit to the chosen samples leaves of a target, at every sample."""
    matrix = np.stack(features, axis=1)
    rows, wanted = (matrix, target) if chosen is None else (matrix[chosen], target[chosen])
    return target - matrix @ solve(rows, wanted)


def left_over(features: Sequence[np.ndarray], target: np.ndarray) -> float:
    """Return the share of a target's variance that a least-squares fit does not explain."""
    spread = float(np.var(target))
    return float(np.var(fit(features, target))) / spread if spread > 0.0 else 0.0


def is_smooth(values: np.ndarray) -> bool:
    """Return whether values follow each other too closely for noise."""
    spread = float(np.var(values))
    return spread > 0.0 and float(np.mean(np.diff(values) ** 2)) < spread


def white_share(values: np.ndarray) -> float:
    """Return the share of a signal's variance that is white noise, by its third differences."""
    spread = float(np.var(values))
    return float(np.mean(np.diff(values, 3) ** 2)) / 20.0 / spread if spread > 0.0 and values.size > 3 else 0.0


def explains(before: float, after: float, noise: float, *, least: float) -> bool:
    """Return whether a cause explains most of what a curve left of a torque beside its noise.

    Args:
        before: share of the variance that was left without it.
        after: with it.
        noise: share that is noise, which nothing explains.
        least: share of `before`, less the noise, that may be left.
    """
    # What is won must also be seen beside the noise.
    return after - noise < least * (before - noise) and before - after > 0.05 * before


def least_of(cost: Callable[[float], float], low: float, high: float) -> float:
    """Return where a cost is least between two bounds with one minimum between them, by golden section."""
    for _ in range(30):
        one, two = low + 0.381966 * (high - low), high - 0.381966 * (high - low)
        low, high = (low, two) if cost(one) < cost(two) else (one, high)
    return 0.5 * (low + high)


def thinned(*columns: np.ndarray) -> list[np.ndarray]:
    """Return every n-th sample of columns of one length, some ten thousand of them."""
    stride = -(-len(columns[0]) // _MOST)
    return [column[::stride] for column in columns]
