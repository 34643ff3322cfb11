"""What one stiffness cannot say: tangent and secant against amplitude, hysteresis, a zero that moves."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from tuning.logs.curves import curve_of, fit, solve

LINE_HOLDS = 0.98
"""One line is said to describe a log that it explains with at least this R²."""
_NAMED = 0.1
"""A cause is named that explains at least this share of what a line leaves unexplained."""
_TURN = 0.1
"""A turn counts whose way back is at least this share of the deflection's range."""
_LOSES = 0.02
"""A loop with at least this loss factor is said to be hysteresis."""
_BENDS = 0.15
"""Relative change of the stiffness from which a spring is said to soften or stiffen."""
_LEVELS = 8
_CELLS = 80
"""Pieces into which a swing from end to end is cut."""
_GAPS = 20
_EDGES = 20
"""The first and the last twentieth of a log are compared with each other."""
_THINNED = 20_000
"""Samples beyond which turning points are sought in every n-th only."""

Cause = Literal["softening", "stiffening", "hysteresis"]


@dataclass(frozen=True)
class Level:
    """Stiffnesses at an amplitude, midway between the branches of a loop; NaN where too few samples lie.

    Args:
        amplitude: |φ − φ₀| [rad].
        secant: slope between φ₀ ± amplitude, from φ₀ itself where only one side was reached [N·m/rad].
        tangent: local slope there [N·m/rad].
    """

    amplitude: float
    secant: float
    tangent: float


@dataclass(frozen=True)
class Swing:
    """The secant of a joint that swings by an amplitude, seen on its way from a turning point.

    A spring without hysteresis shows the same curve from wherever it turns; one with dry friction inside is stiff
    after a turn and softer the farther it swings.

    Args:
        amplitude: half the way from the turning point [rad].
        secant: [N·m/rad].
    """

    amplitude: float
    secant: float


@dataclass(frozen=True)
class Characteristic:
    """Torque over deflection, in numbers.

    Args:
        stiffness: least-squares slope with an offset [N·m/rad].
        torque_at_zero: its torque at zero deflection [N·m].
        r_squared: share of the torque's variance that this line explains.
        center: φ₀, the deflection at rest, or amid its range [rad].
        curvature: share of what the line leaves that a curve explains.
        branches: share of it that a difference between loading and unloading explains.
        both: share of it that both explain together.
        levels: stiffnesses from small to large amplitude.
        swings: secants from turning points, from small to large amplitude; empty without a turn.
        width: largest difference of the torque between the two directions at one deflection [N·m].
        loss: energy a cycle [J].
        loss_factor: the loss over 2π times the elastic energy at the largest deflection.
        shift: how far the deflection at one torque moved from the start of the log to its end [rad]; 0 where the
            ends scatter as much.
        causes: why the line does not hold; empty where it does, or where nothing above explains it.
    """

    stiffness: float
    torque_at_zero: float
    r_squared: float
    center: float
    curvature: float
    branches: float
    both: float
    levels: tuple[Level, ...]
    swings: tuple[Swing, ...]
    width: float
    loss: float
    loss_factor: float
    shift: float
    causes: tuple[Cause, ...]

    @property
    def is_line(self) -> bool:
        """Whether one line describes the log."""
        return self.r_squared > LINE_HOLDS


def characterise(
    deflection: np.ndarray, torque: np.ndarray, *, rest: float | None = None
) -> Characteristic | None:
    """Return what torque over deflection looks like, or `None` where either does not move.

    The line is fitted to the samples. All else is of means over short pieces of the path, of one length in
    deflection: where a joint rests it says nothing new, however long.

    Args:
        deflection: [rad]; lagging as the torque does.
        torque: [N·m].
        rest: the deflection at rest, where it is known [rad].
    """
    span, spread = float(np.ptp(deflection)), float(np.var(torque))
    if not (span > 0.0 and spread > 0.0 and np.isfinite(span) and np.isfinite(spread)):
        return None
    center = 0.5 * float(deflection.min() + deflection.max()) if rest is None else rest
    scaled = 2.0 * (deflection - center) / span
    (intercept, slope), explained = _fit([np.ones_like(scaled), scaled], torque)
    stiffness = 2.0 * slope / span
    path = _pieces(deflection, torque)
    offset, direction = path.deflection - center, path.direction
    x = 2.0 * offset / span
    line = [np.ones_like(x), x]
    curves = [x**power for power in range(2, 6)]
    branches = [direction, direction * x, direction * x * x]
    left = 1.0 - _fit(line, path.torque)[1]

    def gained(*features: np.ndarray) -> float:
        if left < 1e-12 or x.size < 4 * len(features):
            return 0.0
        return max(0.0, 1.0 - (1.0 - _fit([*line, *features], path.torque)[1]) / left)

    curvature, branching, both = gained(*curves), gained(*branches), gained(*curves, *branches)
    levels = _levels(offset, path.torque, direction)
    width, loss, loss_factor = _loop(path, stiffness)
    swings = _swings(path)
    causes: list[Cause] = []
    if explained <= LINE_HOLDS:
        causes = ["hysteresis"] if branching >= _NAMED and loss_factor >= _LOSES else []
        bend = _bend([swing.secant for swing in swings] if causes else [level.tangent for level in levels])
        # Without branches, a curve must also explain what the line does not.
        if bend is not None and (causes or curvature >= _NAMED):
            causes.append(bend)
    return Characteristic(
        stiffness,
        intercept - stiffness * center,
        explained,
        center,
        curvature,
        branching,
        both,
        levels,
        swings,
        width,
        loss,
        loss_factor,
        _shift(deflection, torque, stiffness),
        tuple(causes),
    )


def _shift(deflection: np.ndarray, torque: np.ndarray, stiffness: float) -> float:
    """Return how far the deflection at one torque moved from the start to the end [rad], a curve allowed for."""
    error, edge = fit(curve_of(deflection), torque), max(1, len(torque) // _EDGES)
    first, last = error[:edge], error[-edge:]
    moved, noise = (
        float(np.median(first) - np.median(last)),
        max(float(np.std(first)), float(np.std(last))),
    )
    # What is no larger than what each end does by itself says nothing of a difference between them.
    return moved / stiffness if stiffness and abs(moved) > noise else 0.0


class _Path(NamedTuple):
    """Means over pieces of the path: deflection [rad], torque [N·m], which way it went, and in which swing."""

    deflection: np.ndarray
    torque: np.ndarray
    direction: np.ndarray
    swing: np.ndarray


def _pieces(deflection: np.ndarray, torque: np.ndarray) -> _Path:
    way = directions(deflection)
    swing = np.concatenate([[0], np.cumsum(np.diff(way) != 0)])
    low = deflection.min()
    cell = np.minimum(((deflection - low) / (np.ptp(deflection) / _CELLS)).astype(int), _CELLS - 1)
    _, piece, count = np.unique(swing * _CELLS + cell, return_inverse=True, return_counts=True)
    means = [np.bincount(piece, values) / count for values in (deflection, torque, way, swing)]
    return _Path(means[0], means[1], np.sign(means[2]), np.round(means[3]).astype(int))


def directions(values: np.ndarray) -> np.ndarray:
    """Return 1 where values are on their way up from a turning point to the next, −1 on their way down."""
    stride = max(1, len(values) // _THINNED)
    turns = _turning_points(values[::stride].tolist(), _TURN * float(np.ptp(values)))
    places = np.minimum(np.array(turns) * stride, len(values) - 1)
    found = np.zeros(len(values))
    for start, end in itertools.pairwise(places):
        found[start : end + 1] = np.sign(values[end] - values[start])
    return found


def _turning_points(values: Sequence[float], least: float) -> list[int]:
    """Return the places of extrema that are undone by more than `least`, and both ends."""
    places, low, high, way = [0], 0, 0, 0
    for k, value in enumerate(values):
        if value > values[high]:
            high = k
        if value < values[low]:
            low = k
        if way >= 0 and values[high] - value > least:
            places.append(high)
            way, low, high = -1, k, k
        elif way <= 0 and value - values[low] > least:
            places.append(low)
            way, low, high = 1, k, k
    return sorted({*places, len(values) - 1})


def _fit(features: Sequence[np.ndarray], target: np.ndarray) -> tuple[np.ndarray, float]:
    """Return least-squares coefficients and the share of the variance that they explain."""
    matrix = np.stack(features, axis=1)
    coefficients = solve(matrix, target)
    return coefficients, 1.0 - float(np.var(target - matrix @ coefficients) / np.var(target))


def _levels(offset: np.ndarray, torque: np.ndarray, direction: np.ndarray) -> tuple[Level, ...]:
    distance, top = np.abs(offset), float(np.abs(offset).max())
    at_zero = distance <= 2.0 * top / _CELLS
    center = _midway(torque, at_zero, direction)
    found = []
    for number in range(1, _LEVELS + 1):
        amplitude = top * (number - 0.5) / _LEVELS
        near = np.abs(distance - amplitude) <= 0.5 * top / _LEVELS
        sides = [near & (side * offset > 0) for side in (1, -1)]
        ends = [(float(offset[s].mean()), _midway(torque, s, direction)) for s in sides if s.any()]
        secant = np.nan
        if ends:
            (x, y), (x0, y0) = ends[0], ends[1] if len(ends) == 2 else (0.0, center)
            secant = (y - y0) / (x - x0)
        # Each branch has an intercept of its own.
        tangent = _pooled(offset, torque, [s & (way == direction) for s in sides for way in (1.0, -1.0)])
        found.append(Level(amplitude, secant, tangent))
    return tuple(found)


def _midway(torque: np.ndarray, chosen: np.ndarray, direction: np.ndarray) -> float:
    """Return the mean over both directions of the mean torque; NaN where nothing is chosen."""
    means = [torque[chosen & (direction == way)] for way in (1.0, -1.0)]
    return float(np.mean([m.mean() for m in means if m.size])) if any(m.size for m in means) else np.nan


def _swings(path: _Path) -> tuple[Swing, ...]:
    half = 0.5 * float(np.ptp(path.deflection))
    total, count = np.zeros(_LEVELS), np.zeros(_LEVELS)
    # The first begins wherever the log does, at no turn.
    for number in np.unique(path.swing)[1:]:
        own = path.swing == number
        x, y, way = path.deflection[own], path.torque[own], path.direction[own][0]
        order = np.argsort(way * x)
        x, y = x[order], y[order]
        if np.ptp(x) < half:
            continue
        far = np.abs(x - x[0]) > 0.5 * half / _LEVELS
        if not far.any():
            continue
        y, x = np.append(y[0], y[far]), np.append(x[0], x[far])
        amplitude = 0.5 * np.abs(x - x[0])[1:]
        level = np.minimum((amplitude / half * _LEVELS).astype(int), _LEVELS - 1)
        secant = (y - y[0])[1:] / (x - x[0])[1:]
        total += np.bincount(level, secant, minlength=_LEVELS)
        count += np.bincount(level, minlength=_LEVELS)
    middles = half * (np.arange(_LEVELS) + 0.5) / _LEVELS
    return tuple(Swing(float(a), float(t / n)) for a, t, n in zip(middles, total, count, strict=True) if n)


def _pooled(x: np.ndarray, y: np.ndarray, groups: Sequence[np.ndarray]) -> float:
    """Return the common slope of groups that have an intercept each."""
    parts = [(x[g] - x[g].mean(), y[g]) for g in groups if np.count_nonzero(g) >= 3]
    moved = sum(float(p @ p) for p, _ in parts)
    return sum(float(p @ q) for p, q in parts) / moved if moved > 0.0 else np.nan


def _bend(stiffnesses: Sequence[float]) -> Cause | None:
    """Return whether stiffnesses fall or rise with the amplitude; `None` if they do neither."""
    found = np.array([stiffness for stiffness in stiffnesses if np.isfinite(stiffness)])
    third = found.size // 3
    if not third:
        return None
    small, large = float(found[:third].mean()), float(found[-third:].mean())
    if abs(large - small) < _BENDS * abs(small):
        return None
    return "softening" if large < small else "stiffening"


def _loop(path: _Path, stiffness: float) -> tuple[float, float, float]:
    """Return the widest gap between the directions [N·m], the mean area of the loop [J] and the loss factor."""
    low, reach = float(path.deflection.min()), 0.5 * float(np.ptp(path.deflection))
    step = 2.0 * reach / _GAPS
    cell = np.minimum(((path.deflection - low) / step).astype(int), _GAPS - 1)
    means = []
    for way in (1.0, -1.0):
        chosen = path.direction == way
        count = np.bincount(cell[chosen], minlength=_GAPS)
        total = np.bincount(cell[chosen], path.torque[chosen], minlength=_GAPS)
        means.append(np.where(count > 0, total / np.maximum(count, 1), np.nan))
    gap = means[0] - means[1]
    if not np.isfinite(gap).any():
        return np.nan, np.nan, np.nan
    loss, elastic = float(np.nansum(gap) * step), 0.5 * abs(stiffness) * reach * reach
    return float(np.nanmax(np.abs(gap))), loss, loss / (2.0 * np.pi * elastic) if elastic > 0.0 else np.nan
