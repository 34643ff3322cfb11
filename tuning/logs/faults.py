"""Wrapped encoders, wrong units and swapped signs: found from the numbers alone, and named."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from tuning.logs.columns import LogFile
from tuning.logs.curves import left_over, powers
from tuning.logs.findings import Fault, FaultName, Samples, name_stretches
from tuning.logs.signal_map import Angle, SignalMap

_DEGREE = math.pi / 180.0
_UNITS = {"degrees": _DEGREE, "revolutions": 2.0 * math.pi, "milliradians": 1e-3}
"""What angles are in that are taken for radians, in rad."""
_WIDEST_DEFLECTION = 1.5
"""[rad]; springs that bend further are rarer than wrong units."""
_MOST_TURNS = 8.0
"""Turns of a joint within one log, more than which are rarer than wrong units."""
_ABSURD = 1e100
_AGREES = 0.9
"""Correlation from which two angles are taken to say the same."""
_CLOSE = 0.1
"""Relative distance from a factor within which it is taken to be that factor."""


def find_wraps(name: str, signal: object, values: np.ndarray, log: LogFile, rows: np.ndarray) -> list[Fault]:
    """Return the fault of an angle that jumps by a whole period of its counter, which the map does not undo.

    Args:
        name: of the signal.
        signal: what the map says of it.
        values: as the file has them.
        log: where they are from.
        rows: their rows in the file.
    """
    if not isinstance(signal, Angle) or signal.wraps_at is not None or values.size < 3 or _is_absurd(values):
        return []
    jumps = np.abs(np.diff(values))
    largest = float(jumps.max())
    span = float(np.ptp(values))
    if largest < 0.5 * span or largest == 0.0:
        return []
    is_jump = jumps > 0.5 * largest
    ordinary = float(jumps[~is_jump].max()) if not is_jump.all() else largest
    if ordinary > 0.2 * largest or np.count_nonzero(is_jump) > 0.05 * jumps.size:
        return []
    period = next((p for p in _periods(signal) if abs(largest - p) <= 1.5 * ordinary + 0.02 * p), None)
    first = int(np.argmax(is_jump))
    where = f"between {log.place(int(rows[first]))} and {log.place(int(rows[first + 1]))}"
    times = f", {np.count_nonzero(is_jump)} times in all" if np.count_nonzero(is_jump) > 1 else ""
    said = f"jumps by {largest:.6g} {signal.unit} {where}{times}, where it else moves by {ordinary:.3g} a sample"
    if period is not None:
        return [Fault("wrapped encoder", name, said, f"Set signals.{name}.wraps_at = {period:.10g}")]
    # A command may be a row of steps.
    if _swings(np.diff(values)[is_jump]) and not name.startswith("setpoint"):
        fix = f"Does it wrap? Then set signals.{name}.wraps_at; was it zeroed anew? Then cut the log there"
        return [Fault("wrapped encoder", name, said, fix)]
    return []


def _swings(jumps: np.ndarray) -> bool:
    """Return whether jumps are of one size, as those of a counter are."""
    return bool(np.ptp(np.abs(jumps)) <= 0.1 * np.max(np.abs(jumps)))


def _periods(signal: Angle) -> Iterable[float]:
    turn = {"deg": 360.0, "rad": 2.0 * math.pi, "mrad": 2e3 * math.pi, "rev": 1.0}.get(signal.unit)
    if turn is not None:
        yield from (turn, turn / 2.0)
    if signal.counts_per_revolution is not None:
        yield signal.counts_per_revolution
    if signal.unit == "counts":
        yield from (2.0**bits for bits in range(8, 33))


def find_units(
    signal_map: SignalMap, samples: Mapping[str, Samples], columns: Mapping[str, np.ndarray]
) -> list[Fault]:
    """Return the faults of signals that do not move, leave their range, or look like degrees taken for radians.

    Args:
        signal_map: what the user said.
        samples: signals as the file has them.
        columns: the same in SI.
    """
    found = []
    for name, signal in signal_map.signals.given().items():
        values = columns[name]
        if _is_absurd(values):
            where = samples[name].stretches(np.abs(samples[name].values) > _ABSURD)
            said = f"reaches {np.abs(values).max():.3g}" + (f" at {name_stretches(where)}" if where else "")
            fix = f"Check signals.{name}: column, unit, scale"
            found.append(Fault("out of range", name, said, fix, where=where))
            continue
        low, high = float(values.min()), float(values.max())
        if low == high and not name.startswith(("true_", "setpoint")):
            fix = f"Is signals.{name}.column the right one?"
            found.append(Fault("frozen signal", name, f"is {low:.6g} in every sample", fix))
        is_angle = isinstance(signal, Angle)
        if signal.range is not None and (low < signal.range[0] or high > signal.range[1]):
            said = f"runs from {low:.6g} to {high:.6g}, beyond its range {signal.range}"
            scaled = (_DEGREE * low, _DEGREE * high)
            fits = is_angle and signal.range[0] <= scaled[0] and scaled[1] <= signal.range[1]
            kind: FaultName = "degrees for radians" if fits and signal.unit == "rad" else "out of range"
            fix = (
                f'Set signals.{name}.unit = "deg"?'
                if fits
                else f"Check signals.{name}: column, unit, scale, offset"
            )
            found.append(Fault(kind, name, said, fix))
        elif (
            is_angle
            and signal.unit == "rad"
            and (why := _looks_like_degrees(name, signal, samples[name].values, values))
        ):
            fix = f'Set signals.{name}.unit = "deg"? If it does go so far, say so: signals.{name}.range'
            found.append(Fault("degrees for radians", name, why, fix))
    return found + _disagreements({name: values for name, values in columns.items() if not _is_absurd(values)})


def _is_absurd(values: np.ndarray) -> bool:
    """Return whether squares and differences of values would overflow."""
    return bool(np.abs(values).max() > _ABSURD)


def _looks_like_degrees(name: str, signal: Angle, raw: np.ndarray, values: np.ndarray) -> str | None:
    span = float(np.ptp(values))
    if name == "deflection" and span > _WIDEST_DEFLECTION:
        return f"spans {span:.4g} rad; few springs bend by more than {_WIDEST_DEFLECTION} rad"
    # Motors that move a set-point turn as often as their gear asks for.
    if name not in ("deflection", "setpoint_position") and span > 2.0 * math.pi * _MOST_TURNS:
        return f"spans {span:.4g} rad, {span / (2 * math.pi):.3g} turns of the joint"
    step = resolution(raw)
    if step is None or signal.scale is not None or _is_round(step):
        return None
    in_degrees, in_radians = 360.0 / step, 2.0 * math.pi / step
    if _is_encoder(in_degrees) and not _is_encoder(in_radians):
        return f"moves in steps of {step:.6g}: {in_degrees:.0f} a turn in degrees, but {in_radians:.2f} in radians"
    return None


def resolution(values: np.ndarray) -> float | None:
    """Return the step of which all of a quantised signal's changes are multiples, or `None`."""
    if _is_absurd(values):
        return None
    levels = np.unique(values[:200_000])
    if not 5 <= levels.size <= 50_000 or levels.size > 0.7 * min(values.size, 200_000):
        return None
    steps = np.diff(levels)
    # Binary rounding makes two numbers of one level: their difference is no step.
    steps = steps[steps > 1e-6 * float(np.median(steps))]
    step = float(np.min(steps))
    step = float(np.mean(steps[steps < 1.5 * step]))
    counts = steps / step
    if np.mean(np.abs(counts - np.round(counts)) < 0.1) <= 0.95:
        return None
    # From end to end the step is known far better than from one level to the next.
    span = float(levels[-1] - levels[0])
    return span / float(np.sum(np.round(counts)))


def _is_round(step: float) -> bool:
    """Return whether a step is a rounded print, 1, 2, 2.5 or 5 times a power of ten: no encoder's."""
    digits = step / 10.0 ** math.floor(math.log10(step) + 1e-9)
    return any(abs(digits - d) < 1e-3 * d for d in (1.0, 2.0, 2.5, 5.0, 10.0))


def _is_encoder(count: float) -> bool:
    """Return whether an encoder may have so many counts a turn: whole, and round in binary or decimal."""
    whole = round(count)
    return whole > 1 and abs(count - whole) < 0.01 and (whole % 64 == 0 or whole % 100 == 0)


def _disagreements(columns: Mapping[str, np.ndarray]) -> list[Fault]:
    """Compare angles that must say the same: link with motor, and their difference with the deflection."""
    found = []
    if {"link_position", "motor_position"} <= columns.keys():
        link, motor = columns["link_position"], columns["motor_position"]
        found += _weigh(_compare("motor_position", motor, "link_position", link), columns)
        if "deflection" in columns:
            found += _compare("deflection", columns["deflection"], "link minus motor position", link - motor)
    for number in (1, 2):
        if {"link_position", f"motor{number}_position"} <= columns.keys():
            name = f"motor{number}_position"
            # Motors of a pair may turn against each other: only a factor is a fault.
            pairs = _compare(name, columns[name], "link_position", columns["link_position"])
            found += [fault for fault in pairs if fault.name != "swapped sign"]
    return found


def _weigh(found: list[Fault], columns: Mapping[str, np.ndarray]) -> list[Fault]:
    """Return what is found of motor and link where nothing that shows the deflection speaks against it.

    Above its resonance a link swings against its motor, and near it by a multiple: without a deflection or a
    torque that is a note.
    """
    link, motor = columns["link_position"], columns["motor_position"]
    shown = columns.get("deflection", columns.get("elastic_torque"))
    weighed = []
    for fault in found:
        if fault.name == "degrees for radians":
            weighed.append(fault)
        elif shown is None or not np.ptp(shown) > 0.0:
            weighed.append(replace(fault, severity="note"))
        else:
            sign = -1.0 if fault.name == "swapped sign" else 1.0
            mended = sign * motor * (float(np.std(link) / np.std(motor)) if sign > 0.0 else 1.0)
            own, other = (left_over(powers(link - angle, 3), shown) for angle in (motor, mended))
            weighed += [fault] if other < 0.5 * own else []
    return weighed


def _compare(name: str, values: np.ndarray, other: str, reference: np.ndarray) -> list[Fault]:
    """Return the fault of an angle that is −1 times another, or in another unit than it is taken for."""
    if np.ptp(values) == 0.0 or np.ptp(reference) == 0.0:
        return []
    correlation = float(np.corrcoef(values, reference)[0, 1])
    if not abs(correlation) > _AGREES:
        return []
    factor = float(np.std(values) / np.std(reference))
    found = []
    if correlation < 0.0:
        said, fix = f"falls as the {other} rises", f"Set signals.{name}.sign = -1?"
        found.append(Fault("swapped sign", name, said, fix))
    for unit, size in _UNITS.items():
        for ratio, who in ((1.0 / size, name), (size, other)):
            if abs(factor / ratio - 1.0) < _CLOSE:
                said = f"is {factor:.4g} times the {other}: {who} is in {unit}, though it is taken for radians"
                kind: FaultName = "degrees for radians" if unit == "degrees" else "wrong unit"
                found.append(Fault(kind, name, said, "Check the unit of both"))
    return found
