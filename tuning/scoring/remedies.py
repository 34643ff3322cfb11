"""What to do about failures in a population: which numbers matter, and in what range they would have to stay.

Ranges are found on one half of the scenarios and judged on the other, so that what they promise is honest.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

TARGET = 0.05
"""Share of the robots that may fail where nothing else is said."""
_MOST_FACTORS = 3
_BINS = 20
_LEVELS = 12
"""Different values up to which a number is a choice of levels, not a range."""
_FEWEST = 20
"""Robots that a share of failures is taken from."""
_NARROWEST = 0.25
"""Share of the robots that a range must hold where none meets the target."""
_SURE = 1e-3
"""Chance at which a drop of the failures counts as luck."""
_UNITS = {
    "inertia": "kg·m²",
    "damping": "N·m·s/rad",
    "delay": "s",
    "gain": "",
    "duration": "s",
    "frequency": "Hz",
    "counts_per_revolution": "counts",
    "gear_ratio": "",
    "gravity": "N·m",
}
_CALIBRATED = {"gain", "delay", "bias", "offset"}


@dataclass(frozen=True)
class Kept:
    """A number that would have to stay within a range.

    Args:
        path: of the number.
        low: lower end of the range.
        high: upper end.
        drawn_low: least value of the population.
        drawn_high: largest.
        levels: the values allowed, where the population has few; empty else.
        failing: share of the robots that fail within this range and those before it, on the scenarios it was
            found on.
    """

    path: str
    low: float
    high: float
    drawn_low: float
    drawn_high: float
    levels: list[float]
    failing: float


@dataclass(frozen=True)
class Remedy:
    """What would bring a failure down to the target.

    Args:
        failure: its name.
        failing: share of all robots that fail.
        target: share that may.
        kept: numbers that would have to stay within ranges, the one that matters most first.
        left: share that fails among the robots within all ranges that were not used to find them, with its 95 %
            interval: value, low, high; NaN where there are none.
        robots: how many those are.
    """

    failure: str
    failing: float
    target: float
    kept: list[Kept]
    left: tuple[float, float, float]
    robots: int

    @property
    def meets_target(self) -> bool:
        """Whether no more than the target fail within the ranges, as far as the run can tell."""
        return bool(self.left[0] <= self.target)


def find_remedy(
    failure: str, failed: np.ndarray, numbers: Mapping[str, np.ndarray], target: float = TARGET
) -> Remedy | None:
    """Return what would bring a failure down to a target; `None` where it is there already.

    Numbers are taken one after another: each time the one whose range meets the target and holds the most robots,
    or else leaves the fewest failures. It stops where nothing that varies explains what is left.

    Args:
        failure: its name.
        failed: `(scenario,)` whether it failed.
        numbers: `(scenario,)` values by path.
        target: share that may fail.
    """
    if failed.mean() <= target:
        return None
    # By lot: Sobol points with even numbers lie elsewhere than those with odd ones.
    found_on = np.random.default_rng(0).random(failed.size) < 0.5
    within, kept = np.ones(failed.size, bool), []
    while len(kept) < _MOST_FACTORS and failed[within & found_on].mean() > target:
        here = within & found_on
        used = {one.path for one in kept}
        ranges = {
            path: _best_range(values[here], failed[here], target)
            for path, values in numbers.items()
            if path not in used and np.ptp(values[here]) > 0
        }
        ranked = {path: one for path, one in ranges.items() if one is not None}
        if not ranked:
            break
        path = max(ranked, key=lambda one: ranked[one].worth)
        chosen, values = ranked[path], numbers[path]
        inside = within & (values >= chosen.low) & (values <= chosen.high)
        if not _has_dropped(failed[here], failed[inside & found_on]):
            break
        within = inside
        levels = np.unique(values[inside])
        is_choice = np.unique(values).size <= _LEVELS
        kept.append(
            Kept(
                path,
                chosen.low,
                chosen.high,
                float(values.min()),
                float(values.max()),
                [float(level) for level in levels] if is_choice else [],
                float(failed[inside & found_on].mean()),
            )
        )
    judged = failed[within & ~found_on]
    return Remedy(failure, float(failed.mean()), target, kept, _share(judged), int(judged.size))


@dataclass(frozen=True)
class _Window:
    low: float
    high: float
    count: int
    share: float
    meets: bool

    @property
    def worth(self) -> tuple[bool, float]:
        """First those that meet the target, the widest of them best; then those with the fewest failures."""
        return self.meets, float(self.count) if self.meets else -self.share


def _best_range(values: np.ndarray, failed: np.ndarray, target: float) -> _Window | None:
    levels = np.unique(values)
    if levels.size <= _LEVELS:
        lows = highs = levels
    else:
        edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, _BINS + 1), method="nearest"))
        lows, highs = edges[:-1], edges[1:]
    order = np.argsort(values)
    ordered, failures = values[order], np.append(0, np.cumsum(failed[order]))
    found: list[_Window] = []
    for i, low in enumerate(lows):
        start = int(np.searchsorted(ordered, low, side="left"))
        for high in highs[i:]:
            stop = int(np.searchsorted(ordered, high, side="right"))
            count = stop - start
            share = float(failures[stop] - failures[start]) / max(count, 1)
            is_wide = share <= target or levels.size <= _LEVELS or count >= _NARROWEST * values.size
            if _FEWEST <= count < values.size and is_wide:
                found.append(_Window(float(low), float(high), count, share, share <= target))
    if not found:
        return None
    least = max(found, key=lambda window: window.worth)
    if least.meets:
        return least
    # Of those that are not worse than the best by more than chance, the widest.
    spread = 2.0 * math.sqrt(max(least.share * (1.0 - least.share), 1.0 / least.count) / least.count)
    return max((one for one in found if one.share <= least.share + spread), key=lambda one: one.count)


def _has_dropped(before: np.ndarray, after: np.ndarray) -> bool:
    """Return whether fewer fail than before by more than chance, by the binomial test."""
    test = scipy.stats.binomtest(int(after.sum()), after.size, float(before.mean()), alternative="less")
    return bool(test.pvalue < _SURE)


def _share(failed: np.ndarray) -> tuple[float, float, float]:
    if not failed.size:
        return float("nan"), float("nan"), float("nan")
    ends = scipy.stats.binomtest(int(failed.sum()), failed.size).proportion_ci(0.95, method="exact")
    return float(failed.mean()), float(ends.low), float(ends.high)


def advise(remedy: Remedy, definition: str, numbers: Mapping[str, float]) -> list[str]:
    """Return what a remedy says, as lines for people.

    Args:
        remedy: what was found.
        definition: of the failure, with its unit.
        numbers: the study's own values by path, in which the estimator's beliefs are looked up.
    """
    lines = [f"{remedy.failure} ({definition}): {_percent(remedy.failing)} fail, {_percent(remedy.target)} may"]
    if not remedy.kept:
        lines.append(
            "  no number that varies explains it: robots fail alike. Tune for the population, or allow more in "
            "[population.failures]"
        )
        return lines
    for i, kept in enumerate(remedy.kept):
        weight = "matters most" if i == 0 else "matters next"
        lines.append(f"  {kept.path} {weight}: keep it {_range(kept, numbers.get(kept.path))}")
        lines.append(f"    {_identify(kept, numbers)}")
    value, low, high = remedy.left
    together = "there" if len(remedy.kept) == 1 else "within all of these"
    if not remedy.robots:
        lines.append(f"  no robot is left {together} to judge it by: run more --scenarios")
        return lines
    said = f"{_percent(value)} fail {together} [{_percent(low)}, {_percent(high)}]"
    said += f", of {remedy.robots} robots not used to find it"
    if remedy.meets_target:
        lines.append(f"  then {said}")
    else:
        lines.append(f"  even then {said}: tune the estimator for the population too, or allow more failures")
    return lines


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %"


def _range(kept: Kept, own: float | None) -> str:
    unit = _UNITS.get(kept.path.rpartition(".")[2], "")
    unit = f" {unit}" if unit else ""
    drawn = f"drawn: {kept.drawn_low:.5g} … {kept.drawn_high:.5g}{unit}"
    if kept.levels:
        return f"at {' or '.join(f'{level:.5g}' for level in kept.levels)}{unit} ({drawn})"
    relative = ""
    if own:
        ends = sorted(100.0 * (end / own - 1.0) for end in (kept.low, kept.high))
        relative = f", {ends[0]:+.1f} … {ends[1]:+.1f} % of the study's {own:.4g}"
    return f"within {kept.low:.4g} … {kept.high:.4g}{unit}{relative} ({drawn})"


def _identify(kept: Kept, numbers: Mapping[str, float]) -> str:
    """Return how a number is kept there: measured and believed, calibrated, chosen or set."""
    root, name = kept.path.partition(".")[0], kept.path.rpartition(".")[2]
    beliefs = _beliefs(kept.path, numbers)
    if beliefs:
        return f"identify it on each robot and set {' and '.join(beliefs)} to what was found"
    if root == "sensing":
        if name in _CALIBRATED:
            return "calibrate this sensor on each robot"
        return "choose a sensor that has it"
    if root in {"joint", "plant"}:
        return "no number of the estimator stands for it: build the joint so, or sort out robots that are not"
    if root in {"estimator", "controller", "observer"}:
        return "set it there: it is the program's own number"
    return "see that it stays there in use"


def _beliefs(path: str, numbers: Mapping[str, float]) -> Sequence[str]:
    """Return the estimator's numbers that stand for one of the joint: the same name, and the same value."""
    parts = path.split(".")
    if parts[0] != "joint" or len(parts) < 3:
        return []
    names = {"_".join(parts[-2:]), parts[-1]}
    return [
        other
        for other, value in numbers.items()
        if other.startswith("estimator.") and other.rpartition(".")[2] in names and value == numbers.get(path)
    ]
