"""Faults of single samples and of stretches: spikes, and readings that were held, zeroed or cut off."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from tuning.logs.curves import curve_of, fit, white_share
from tuning.logs.findings import Fault, FaultName, Samples, Stretch, name_stretches, runs_of
from tuning.logs.signal_map import Angle, Stiffness, Torque

_SPIKE = 2
"""Samples that a spike lasts at most."""
_ISOLATED = 8.0
"""Times that a spike stands out from what the samples around it do."""
_AROUND = 20
_LEAST_SPIKE = 0.05
"""Share of a signal's range that a spike is at least."""
_RAREST = 0.01
"""Share of the samples; what more of them do is no spike."""
_HELD = 20
"""Equal readings one after the other from which a signal may be held."""
_CUT_OFF = 5
"""The same for readings at the end of its range."""
_AT_END = 10
"""Readings at an end of the range from which it is cut off, where others are never alike."""
_ALIKE = 0.9
"""Share of different readings from which they are never alike."""
_QUANTA = 3.0
"""Counts by which readings scatter at least that are never alike."""
_FEWEST_BESIDE = 50
_NOISY = 0.7
"""Standard deviation of second differences over that of first ones, from which a signal is noisy: √3 is white."""
_CONTRADICTS = 4.0
"""Times that what the spring's curve leaves is larger where a reading is held."""
_MATTERS = 0.05
"""The least such contradiction, as a share of the torque's standard deviation."""
_MOVES = 0.02
"""Share of its range by which another signal moves while one is held."""

_NO_NOISE = "its noise is gone there, though the joint moves"
_AT_ITS_END = "its readings are else never alike"
_NO_CURVE = "torque and deflection do not go together there as they do elsewhere"
_CUT = "Cut these samples out of the file; its clock may be irregular"


def find_spikes(samples: Samples, signal: Angle | Torque | Stiffness) -> list[Fault]:
    """Return the fault of a signal that leaves its neighbours for one sample or two, and comes back.

    Args:
        samples: as the file has them.
        signal: what the map says of it.
    """
    values = samples.values.astype(np.float64)
    if values.size < 2 * _AROUND or not np.isfinite(values).all():
        return []
    if isinstance(signal, Angle) and signal.wraps_at is not None:
        values = np.unwrap(values, period=signal.wraps_at)
    with np.errstate(over="ignore", invalid="ignore"):
        size = _departure(values)
        steps = np.abs(np.diff(values))
        low, high = np.quantile(values, [0.005, 0.995])
        quantum = float(steps[steps > 0.0].min(initial=math.inf))
        usual = 3.0 * float(np.quantile(size, 1.0 - _RAREST))
        candidate = size > max(_LEAST_SPIKE * (high - low), usual, 4.0 * quantum if quantum < math.inf else 0.0)
    if not candidate.any() or np.count_nonzero(candidate) > max(3.0, _RAREST * values.size):
        return []
    found = [(a, b) for a, b in runs_of(candidate) if _stands_alone(values, size, candidate, a, b)]
    if not found:
        return []
    where = tuple(samples.stretch(a, b) for a, b in found)
    at = np.concatenate([np.arange(a, b + 1) for a, b in found])
    largest, ordinary = float(size[at].max()), float(np.quantile(steps, 0.95))
    unit = signal.unit
    said = f"leaves the readings beside it by up to {largest:.4g} {unit}"
    if np.ptp(values[at]) == 0.0 and (len(found) > 1 or values[at[0]] == 0.0):
        said = f"drops to {values[at[0]]:.6g} {unit}"
    elif (turn := _turn(signal)) is not None and np.all(_is_multiple(size[at], turn)):
        said = f"is off by a turn, {turn:.6g} {unit},"
    said += f" at {name_stretches(where)}, where it else moves by {ordinary:.3g} {unit} a sample"
    return [Fault("spikes", samples.name, said, _CUT, where=where)]


def _departure(values: np.ndarray) -> np.ndarray:
    """Return how far each sample is from the median of five, itself amid them."""
    width = 2 * _SPIKE + 1
    padded = np.pad(values, _SPIKE, mode="edge")
    return np.abs(values - np.median(np.lib.stride_tricks.sliding_window_view(padded, width), axis=1))


def _stands_alone(values: np.ndarray, size: np.ndarray, candidate: np.ndarray, first: int, last: int) -> bool:
    """Return whether a run of candidates is short, comes back to where it left, and is amid quiet samples."""
    if last - first >= _SPIKE or first == 0 or last == values.size - 1:
        return False
    least = float(size[first : last + 1].min())
    if not abs(values[last + 1] - values[first - 1]) < 0.5 * least:
        return False
    around = slice(max(0, first - _AROUND), last + 1 + _AROUND)
    quiet = np.concatenate([size[around][~candidate[around]], [0.0]])
    return least > _ISOLATED * float(quiet.max())


def _turn(signal: Angle | Torque | Stiffness) -> float | None:
    if not isinstance(signal, Angle):
        return None
    turns = {"deg": 360.0, "rad": 2.0 * math.pi, "mrad": 2e3 * math.pi, "rev": 1.0}
    return turns.get(signal.unit, signal.counts_per_revolution)


def _is_multiple(values: np.ndarray, of: float) -> np.ndarray:
    return (np.abs(values / of - np.round(values / of)) < 0.02) & (values > 0.5 * of)


def find_held(time: np.ndarray, columns: Mapping[str, np.ndarray], samples: Mapping[str, Samples]) -> list[Fault]:
    """Return the faults of signals that stay at one reading for a while and cannot have.

    A joint may rest, and a link may be held: equal readings are no fault. They are where the noise that the signal
    else has is gone while the joint moves, or where torque and deflection contradict the curve of the rest.

    Args:
        time: [s].
        columns: signals at these instants, in SI.
        samples: the same where their file has them.
    """
    candidates: dict[str, list[tuple[int, int]]] = {}
    for name, values in columns.items():
        if name.startswith(("true_", "setpoint")) or not np.ptp(values) > 0.0:
            continue
        runs = _equal_runs(values)
        others = [x for other, x in columns.items() if other != name and not other.startswith("true_")]
        runs = [(a, b) for a, b in runs if any(np.ptp(x[a : b + 1]) > _MOVES * np.ptp(x) for x in others)]
        if runs:
            candidates[name] = runs
    known = {name: runs for name, runs in candidates.items() if _has_lost_noise(columns[name], runs)}
    found = [_held_fault(samples[name], time, columns[name], runs, _NO_NOISE) for name, runs in known.items()]
    for name, values in columns.items():
        # A motor's command may well be limited.
        is_sensor = not name.startswith(("true_", "setpoint")) and not name.endswith("motor_torque")
        if name not in known and is_sensor and (runs := _cut_off(values)):
            known[name] = runs
            found.append(_held_fault(samples[name], time, values, runs, _AT_ITS_END))
    # What contradicts the spring where another signal is held says nothing of this one.
    explained = _within(time.size, [run for runs in known.values() for run in runs])
    others = [name for name in candidates if name not in known]
    for name in sorted(others, key=lambda name: -max(last - first for first, last in candidates[name])):
        runs = [(a, b) for a, b in candidates[name] if not explained[a : b + 1].any()]
        runs = _contradicting(name, columns, explained | _within(time.size, runs), runs)
        if runs:
            found.append(_held_fault(samples[name], time, columns[name], runs, _NO_CURVE))
            explained |= _within(time.size, runs)
    return found


def _cut_off(values: np.ndarray) -> list[tuple[int, int]]:
    """Return the stretches at an end of the range where readings that else are never alike are equal."""
    found: list[tuple[int, int]] = []
    for end in (values.min(), values.max()):
        there = values == end
        beside = values[(values > values.min()) & (values < values.max())]
        if np.count_nonzero(there) < _AT_END or beside.size < _FEWEST_BESIDE:
            continue
        levels = np.unique(beside)
        scatter = float(np.sqrt(white_share(beside) * np.var(beside)))
        # An encoder stays at a count wherever its joint turns.
        if levels.size > _ALIKE * beside.size and scatter > _QUANTA * float(np.diff(levels).min()):
            places = np.flatnonzero(there)
            breaks = np.flatnonzero(np.diff(places) > _CUT_OFF)
            first, last = places[np.append(0, breaks + 1)], places[np.append(breaks, places.size - 1)]
            found += zip(first.tolist(), last.tolist(), strict=True)
    # Once, as at rest before a motion to one side, it may be so.
    return sorted(found) if len(found) > 1 else []


def _within(size: int, runs: list[tuple[int, int]]) -> np.ndarray:
    """Return which of so many samples lie in one of the runs."""
    inside = np.zeros(size, dtype=bool)
    for first, last in runs:
        inside[first : last + 1] = True
    return inside


def _equal_runs(values: np.ndarray) -> list[tuple[int, int]]:
    """Return the runs of equal values that are long, or at an end of the range again and again."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1, [values.size]])
    first, last = edges[:-1], edges[1:] - 1
    length = last - first + 1
    long = length >= _HELD
    for end in (values.min(), values.max()):
        there = (values[first] == end) & (length >= _CUT_OFF)
        if length[there].sum() >= _HELD:
            long |= there
    return [(int(a), int(b)) for a, b in zip(first[long], last[long], strict=True)]


def _has_lost_noise(values: np.ndarray, runs: list[tuple[int, int]]) -> bool:
    """Return whether a signal is too noisy for runs of equal readings."""
    held = _within(values.size, runs)
    beside = ~held
    beside[1:] &= ~held[:-1]
    chosen = values[beside]
    if chosen.size < _FEWEST_BESIDE:
        return False
    steps = np.diff(chosen)
    spread = float(np.std(steps))
    is_continuous = spread > 0.0 and float(np.mean(steps == 0.0)) < 0.02
    return is_continuous and float(np.std(np.diff(chosen, 2))) > _NOISY * spread


def _contradicting(
    name: str, columns: Mapping[str, np.ndarray], held: np.ndarray, runs: list[tuple[int, int]]
) -> list[tuple[int, int]]:
    """Return the runs in which torque and deflection contradict the curve of what lies beside all runs."""
    torque = columns.get("elastic_torque")
    deflection = columns.get("deflection")
    if deflection is None and {"link_position", "motor_position"} <= columns.keys():
        deflection = columns["link_position"] - columns["motor_position"]
    elif name in ("link_position", "motor_position"):
        return []
    beside = ~held
    if torque is None or deflection is None or np.count_nonzero(beside) < max(_FEWEST_BESIDE, 0.1 * held.size):
        return []
    setpoint = columns.get("setpoint_position")
    left = fit(curve_of(deflection, setpoint, order=3), torque, beside)
    outside = float(np.sqrt(np.mean(left[beside] ** 2)))
    limit = max(_CONTRADICTS * outside, _MATTERS * float(np.std(torque[beside])))
    return [(a, b) for a, b in runs if float(np.sqrt(np.mean(left[a : b + 1] ** 2))) > limit]


def _stretches(time: np.ndarray, runs: list[tuple[int, int]], samples: Samples) -> list[Stretch]:
    places = [np.searchsorted(samples.time, time[[a, b]]).clip(0, samples.time.size - 1) for a, b in runs]
    return [samples.stretch(int(a), int(b)) for a, b in places]


def _held_fault(
    samples: Samples, time: np.ndarray, values: np.ndarray, runs: list[tuple[int, int]], why: str
) -> Fault:
    name, where = samples.name, tuple(_stretches(time, runs, samples))
    low, high = float(values.min()), float(values.max())
    levels = {float(values[first]) for first, _ in runs}
    share = sum(last - first + 1 for first, last in runs) / values.size
    unit = "N·m" if name.endswith("torque") else "rad"
    said = f"at {name_stretches(where)}, {100 * share:.2g} % of the log: {why}"
    if levels == {0.0}:
        kind: FaultName = "zeroed signal"
        return Fault(kind, name, f"is exactly 0 {said}", f"Was the sensor off? {_CUT}", where=where)
    if levels <= {low, high} and len(runs) > 1:
        reached = " and ".join(f"{level:.6g}" for level in sorted(levels))
        stop = " or the spring at its stop" if name in ("deflection", "link_position") else ""
        fix = f"Is the sensor saturated{stop}? Widen its range, drive less, or cut these samples out of the file"
        return Fault("saturated signal", name, f"stays at {reached} {unit} {said}", fix, where=where)
    return Fault(
        "held signal", name, f"stays at one reading {said}", f"Did the sensor drop out? {_CUT}", where=where
    )
