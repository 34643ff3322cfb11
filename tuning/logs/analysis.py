"""What a log says beyond its stiffness: noise at rest and without load, hysteresis, faults."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from tuning.logs.characteristic import Characteristic, characterise
from tuning.logs.curves import curve_of, fit, is_smooth
from tuning.logs.findings import Fault, is_sound
from tuning.logs.positions import gear_factor
from tuning.logs.reading import RecordingTable
from tuning.logs.torques import (
    Assumptions,
    find_coarse,
    find_delay,
    find_lag,
    find_negative_loop,
    find_offset,
    find_unrelated,
    judge_stiffness,
)

_MOVES = 0.05
"""Share of its range by which a signal that leaves rest has moved."""
_CORRELATED = 3.0
"""Most times that filtered noise exceeds what its differences tell."""
_NOISE = 6.0
"""Standard deviations at rest, which noise hardly ever leaves."""
_SHORTEST_REST = 0.25
_FEWEST_AT_REST = 20
_CORRELATED_ALL_THE_SAME = 0.9
"""Correlation from which a slope is judged though a set-point moved."""
_WITHIN = 0.999
"""Share of the samples without load that lie within the noise floor."""


@dataclass(frozen=True)
class Rest:
    """The first stretch of a log, in which nothing moves.

    Args:
        until: its end [s].
        deflection: its median [rad].
        deflection_std: noise of the deflection [rad].
        torque_std: noise of the torque [N·m].
    """

    until: float
    deflection: float
    deflection_std: float
    torque_std: float


@dataclass(frozen=True)
class NoiseFloor:
    """The torque signal where nothing loads the joint.

    Args:
        start: of that stretch [s].
        end: of it [s].
        bias: mean of the torque there [N·m].
        std: its standard deviation [N·m].
        limit: 99.9 % of it lie within ± this of the bias [N·m]: a figure of this stretch, no promise of another.
        held_out: share of one half of it that lies within the limit of the other half, the smaller of the two.
        share_within: how much of the rest of the log lies within the limit; NaN where nothing is left.
    """

    start: float
    end: float
    bias: float
    std: float
    limit: float
    held_out: float
    share_within: float


@dataclass(frozen=True)
class Analysis:
    """What the numbers of a log say.

    Args:
        deflection: as the torque lags [rad].
        torque: into the fit [N·m].
        characteristic: torque over deflection at the sound samples; `None` where either does not move, or where a
            set-point moved the curve.
        rest: `None` where the log starts in motion.
        floor: `None` where the map tells of no stretch without load.
        correlation: of torque and deflection; NaN where either does not move.
        attenuation: share of the slope that the deflection's noise takes away; NaN without a rest.
        gear_ratio: at which link and motor agree best; NaN without both, or without deflection and torque.
        faults: what is wrong, and notes on what is odd.
        excluded: samples that faults concern, which are left out of the characteristic.
        given: what the estimator takes for granted.
    """

    deflection: np.ndarray
    torque: np.ndarray
    characteristic: Characteristic | None
    rest: Rest | None
    floor: NoiseFloor | None
    correlation: float
    attenuation: float
    gear_ratio: float
    faults: tuple[Fault, ...]
    excluded: int
    given: Assumptions

    @property
    def is_faulty(self) -> bool:
        """Whether something is wrong: then what a line leaves has no cause in the spring."""
        return any(fault.severity == "fault" for fault in self.faults)

    def summary(self) -> dict[str, Any]:
        """Return the numbers for machines."""
        line = self.characteristic
        return {
            "line": None if line is None else asdict(line),
            "rest": None if self.rest is None else asdict(self.rest),
            "noise_floor": None if self.floor is None else asdict(self.floor),
            "correlation": self.correlation,
            "noise_attenuation": self.attenuation,
            "gear_ratio": self.gear_ratio,
            "excluded_samples": self.excluded,
            **fault_facts(self.faults),
        }

    def sentences(self) -> list[str]:
        """Return the same for people."""
        said = fault_sentences(self.faults)
        if (line := self.characteristic) is not None:
            said.append(self._describe(line))
        if self.floor is not None:
            said.append(_describe_floor(self.floor))
        if self.rest is not None and self.attenuation > 0.002:
            said.append(
                f"noise of the deflection at rest, {1e3 * self.rest.deflection_std:.3g} mrad, "
                f"makes the stiffness {100 * self.attenuation:.2g} % too small"
            )
        return said

    @property
    def is_coarse(self) -> bool:
        """Whether the deflection has too few counts for loops and bends to be told from its rounding."""
        return any(fault.name == "coarse deflection" for fault in self.faults)

    @property
    def is_early(self) -> bool:
        """Whether a late deflection would explain the loop as well as hysteresis does."""
        return any(fault.name == "early torque" for fault in self.faults)

    @property
    def causes(self) -> tuple[str, ...]:
        """Why one stiffness does not describe the log, in words; empty where it does, or a fault may be why."""
        line = self.characteristic
        if line is None or self.is_faulty or self.is_coarse:
            return ()
        if "hysteresis" in line.causes and self.is_early:
            return ("loading and unloading differ",)
        if "hysteresis" in line.causes and not self.given.is_measured:
            return ("loading and unloading differ, by friction of the motor or hysteresis",)
        return line.causes

    def _describe(self, line: Characteristic) -> str:
        without = f" without {self.excluded} of the samples" if self.excluded else ""
        share = f"a line explains {100 * line.r_squared:.4g} % of the torque's variance{without}"
        # Samples left out by their torque, as those beyond its range, bias the line.
        is_chosen = any(fault.name == "saturated signal" for fault in self.faults)
        if self.excluded and line.is_line and not is_chosen:
            share += f", {line.stiffness:.6g} N·m/rad"
        if self.is_faulty or self.is_coarse:
            return share
        span = 2.0 * max((level.amplitude for level in line.levels), default=0.0)
        if self.given.is_measured and abs(line.shift) > _MOVES * span:
            share += (
                f"; at one torque the deflection moved by {1e3 * line.shift:.3g} mrad from start to end: "
                "hysteresis, or something slipped"
            )
        if line.is_line:
            return share
        if not line.causes:
            left = fit(curve_of(self.deflection), self.torque)
            if is_smooth(left):
                return f"{share}. What is left is no noise, but neither a curve nor a loop explains it"
            return f"{share}. What is left looks like noise"
        causes = _name_causes(line, self.given, is_early=self.is_early)
        return f"ONE STIFFNESS DOES NOT DESCRIBE THIS LOG: {share}. {causes}"


def fault_sentences(faults: Iterable[Fault]) -> list[str]:
    """Return faults and notes for people, faults first."""
    in_order = sorted(faults, key=lambda fault: fault.severity != "fault")
    return [f"{'WARNING' if fault.severity == 'fault' else 'note'}: {fault}" for fault in in_order]


def fault_facts(faults: Iterable[Fault]) -> dict[str, Any]:
    """Return faults and notes for machines."""
    found = [asdict(fault) for fault in faults]
    return {
        "faults": [one for one in found if one["severity"] == "fault"],
        "remarks": [one for one in found if one["severity"] == "note"],
    }


def analyse(
    table: RecordingTable,
    deflection: np.ndarray,
    torque: np.ndarray,
    given: Assumptions | None = None,
    *,
    unlagged: np.ndarray | None = None,
) -> Analysis:
    """Return what a log says.

    Args:
        table: the log.
        deflection: as the torque lags [rad].
        torque: into the fit [N·m].
        given: what the estimator takes for granted; by default it reads a torque sensor and fits an offset.
        unlagged: the deflection itself, where the torque lags [rad].
    """
    given = given or Assumptions()
    time, faults = table.columns["time"], list(table.faults)
    sound = is_sound(time, faults) & np.isfinite(deflection) & np.isfinite(torque)
    bent, twisted = deflection[sound], torque[sound]
    trusted = {name: values[sound] for name, values in table.columns.items()}
    rest = find_rest(time[sound], bent, twisted) if bent.size else None
    setpoint = table.columns.get("setpoint_position")
    setpoint = None if setpoint is None or not np.ptp(setpoint) > 0.0 else setpoint[sound]
    line = characterise(bent, twisted, rest=None if rest is None else rest.deflection) if bent.size else None
    correlation = attenuation = math.nan
    if line is not None:
        correlation = math.copysign(math.sqrt(max(line.r_squared, 0.0)), line.stiffness)
        if setpoint is None or abs(correlation) > _CORRELATED_ALL_THE_SAME:
            faults += judge_stiffness(line.stiffness, table.signal_map, correlation)
        if rest is not None:
            attenuation = rest.deflection_std**2 / float(np.var(bent))
        if not any(fault.severity == "fault" for fault in faults):
            faults += _judge_curve(time[sound], bent, twisted, setpoint, line, given)
            faults += find_coarse(bent if unlagged is None else unlagged[sound])
            if unlagged is not None:
                faults += find_lag(unlagged[sound], bent, twisted, setpoint, given)
    mapped = table.signal_map.signals.motor_position
    return Analysis(
        deflection,
        torque,
        # One stiffness is not claimed where a set-point moves.
        line if setpoint is None else None,
        rest,
        _noise_floor(time[sound], twisted, table.signal_map.expect.no_load),
        correlation,
        attenuation,
        math.nan if mapped is None else mapped.gear_ratio * gear_factor(trusted),
        tuple(dict.fromkeys(faults)),
        int(np.count_nonzero(~sound)),
        given,
    )


def _judge_curve(
    time: np.ndarray,
    deflection: np.ndarray,
    torque: np.ndarray,
    setpoint: np.ndarray | None,
    line: Characteristic,
    given: Assumptions,
) -> list[Fault]:
    """Return what torque over deflection says; the first that explains it speaks alone."""
    curve = (deflection, torque, setpoint, given)
    found = find_delay(time, *curve) or find_unrelated(*curve)
    if not found and setpoint is None:
        found = find_negative_loop(line.loss_factor, line.branches, given)
    return found + find_offset(*curve)


def find_rest(time: np.ndarray, deflection: np.ndarray, torque: np.ndarray) -> Rest | None:
    """Return the stretch from the start until deflection or torque move by a twentieth of their range."""
    first = max(int(np.searchsorted(time, time[0] + _SHORTEST_REST)), _FEWEST_AT_REST)
    end = len(time)
    for values in (deflection, torque):
        # Bounded by that of differences, so that a slow movement does not pass for noise.
        rough = float(np.std(np.diff(values[:first]))) / math.sqrt(2.0)
        noise = min(float(np.std(values[:first])), _CORRELATED * rough)
        limit = max(_MOVES * float(np.ptp(values)), _NOISE * noise)
        moved = np.abs(values - np.median(values[:first])) > limit
        if moved.any():
            end = min(end, int(np.argmax(moved)))
    if end == len(time):
        return None
    # Who moves slowly is within the limit for long, but not at rest.
    while end >= first and not _is_still(deflection[:end]):
        end = int(0.8 * end)
    if end < first:
        return None
    return Rest(
        float(time[end - 1]),
        float(np.median(deflection[:end])),
        _noise(deflection[:end]),
        _noise(torque[:end]),
    )


def _is_still(values: np.ndarray) -> bool:
    """Return whether values scatter no more than noise that their differences show, filtered or not."""
    steps = float(np.std(np.diff(values))) / math.sqrt(2.0)
    return _noise(values) <= _CORRELATED * steps or not float(np.ptp(values)) > 0.0


def _noise(values: np.ndarray) -> float:
    """Return a standard deviation that the first movement at the end of a rest does not disturb."""
    spread = float(np.median(np.abs(values - np.median(values)))) / 0.6745
    # Most samples of a coarse encoder are the median itself.
    return spread or float(np.std(values))


def _noise_floor(time: np.ndarray, torque: np.ndarray, no_load: list[float] | None) -> NoiseFloor | None:
    if no_load is None:
        return None
    inside = (time >= no_load[0]) & (time <= no_load[1])
    if np.count_nonzero(inside) < _FEWEST_AT_REST:
        return None
    bias = float(torque[inside].mean())
    limit = float(np.quantile(np.abs(torque[inside] - bias), _WITHIN))
    rest = np.abs(torque[~inside] - bias) <= limit
    halves = np.array_split(np.abs(torque[inside] - bias), 2)
    held_out = [np.mean(other <= np.quantile(own, _WITHIN)) for own, other in (halves, halves[::-1])]
    return NoiseFloor(
        no_load[0],
        no_load[1],
        bias,
        float(torque[inside].std()),
        limit,
        float(min(held_out)),
        float(rest.mean()) if rest.size else math.nan,
    )


def leaves_floor(torque: np.ndarray, floor: NoiseFloor) -> np.ndarray:
    """Return from which sample on the torque has shown itself above its noise floor."""
    return np.maximum.accumulate(np.abs(torque - floor.bias)) > 2.0 * floor.limit


def _name_causes(line: Characteristic, given: Assumptions, *, is_early: bool) -> str:
    found = ", ".join(line.causes).upper()
    if "hysteresis" not in line.causes:
        seen = [level for level in line.levels if math.isfinite(level.tangent)]
        near, far = seen[0], seen[-1]
        return (
            f"{found}; the tangent goes from {near.tangent:.4g} N·m/rad at {near.amplitude:.3g} rad from rest "
            f"to {far.tangent:.4g} at {far.amplitude:.3g} rad"
        )
    loop = f"a loop {line.width:.3g} N·m wide, loss factor {line.loss_factor:.2g}"
    if is_early:
        return f"LOADING AND UNLOADING DIFFER, {loop}: see the note on the early torque"
    if given.is_measured:
        said = f"{found}, {loop}"
    else:
        said = (
            f"LOADING AND UNLOADING DIFFER, {loop}: errors of the motor's model (friction, damping, inertia in "
            "estimator.torque, its velocity) make such a loop as well as hysteresis of the spring; motor data "
            "alone do not tell"
        )
    if line.swings:
        first, last = line.swings[0], line.swings[-1]
        said += (
            f"; swings of {first.amplitude:.3g} rad have a secant of {first.secant:.4g} N·m/rad, "
            f"of {last.amplitude:.3g} rad {last.secant:.4g}"
        )
    return said


def _describe_floor(floor: NoiseFloor) -> str:
    after = ""
    if math.isfinite(floor.share_within):
        after = f"; {100 * floor.share_within:.4g} % of the other samples lie within"
    return (
        f"torque without load, {floor.start:g} to {floor.end:g} s: {floor.bias:.3g} ± {floor.limit:.3g} N·m "
        f"holds 99.9 % of these samples; the limit of one half of them holds {100 * floor.held_out:.4g} % of the "
        f"other{after}"
    )


def clock_facts(table: RecordingTable) -> Mapping[str, Any]:
    """Return the clock's report for machines."""
    clock = table.clock
    return {
        "median_step": clock.median,
        "slow_step": clock.slow,
        "missing": clock.missing,
        "gaps": [asdict(gap) for gap in clock.gaps[:20]],
        "gap_count": len(clock.gaps),
    }
