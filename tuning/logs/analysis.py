"""What a log says beyond its stiffness: noise at rest and without load, hysteresis, the gear, faults."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from tuning.logs.characteristic import Characteristic, characterise
from tuning.logs.faults import Fault, judge_stiffness
from tuning.logs.reading import RecordingTable

_MOVES = 0.05
"""Share of its range by which a signal that leaves rest has moved."""
_CORRELATED = 3.0
"""Most times that filtered noise exceeds what its differences tell."""
_NOISE = 6.0
"""Standard deviations at rest, which noise hardly ever leaves."""
_SHORTEST_REST = 0.25
_FEWEST_AT_REST = 20
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
        limit: 99.9 % of it lie within ± this of the bias [N·m].
        share_within: how much of the rest of the log does; NaN where nothing is left.
    """

    start: float
    end: float
    bias: float
    std: float
    limit: float
    share_within: float


@dataclass(frozen=True)
class Analysis:
    """What the numbers of a log say.

    Args:
        deflection: as the torque lags [rad].
        torque: into the fit [N·m].
        characteristic: torque over deflection; `None` where either does not move.
        rest: `None` where the log starts in motion.
        floor: `None` where the map tells of no stretch without load.
        correlation: of torque and deflection; NaN where either does not move.
        attenuation: share of the slope that the deflection's noise takes away; NaN without a rest.
        gear_factor: turns of the motor, as mapped, for one of the link: 1 where the map's ratio is right; NaN
            without both.
        gear_ratio: of the map times that; NaN without both.
        faults: what is wrong.
    """

    deflection: np.ndarray
    torque: np.ndarray
    characteristic: Characteristic | None
    rest: Rest | None
    floor: NoiseFloor | None
    correlation: float
    attenuation: float
    gear_factor: float
    gear_ratio: float
    faults: tuple[Fault, ...]

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
            "faults": [asdict(fault) for fault in self.faults],
        }

    def sentences(self) -> list[str]:
        """Return the same for people."""
        said = [f"WARNING: {fault}" for fault in self.faults]
        if (line := self.characteristic) is not None:
            said.append(_describe(line))
        if self.floor is not None:
            said.append(_describe_floor(self.floor))
        if self.rest is not None and self.attenuation > 0.002:
            said.append(
                f"noise of the deflection at rest, {1e3 * self.rest.deflection_std:.3g} mrad, "
                f"makes the stiffness {100 * self.attenuation:.2g} % too small"
            )
        if abs(self.gear_factor - 1.0) > 1e-3:
            said.append(
                f"link and motor agree at a gear ratio of {self.gear_ratio:.5g}, "
                f"{100 * (self.gear_factor - 1.0):+.2g} % from the map's"
            )
        return said


def analyse(table: RecordingTable, deflection: np.ndarray, torque: np.ndarray) -> Analysis:
    """Return what a log says.

    Args:
        table: the log.
        deflection: as the torque lags [rad].
        torque: into the fit [N·m].
    """
    time = table.columns["time"]
    faults = list(table.faults)
    rest = find_rest(time, deflection, torque)
    line = characterise(deflection, torque, rest=None if rest is None else rest.deflection)
    correlation = attenuation = math.nan
    if line is not None:
        correlation = math.copysign(math.sqrt(max(line.r_squared, 0.0)), line.stiffness)
        faults += judge_stiffness(line.stiffness, table.signal_map, correlation)
        if rest is not None:
            attenuation = rest.deflection_std**2 / float(np.var(deflection))
    factor, ratio = _gear(table)
    return Analysis(
        deflection,
        torque,
        line,
        rest,
        _noise_floor(time, torque, table.signal_map.expect.no_load),
        correlation,
        attenuation,
        factor,
        ratio,
        tuple(dict.fromkeys(faults)),
    )


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
    if end < first or end == len(time):
        return None
    return Rest(
        float(time[end - 1]),
        float(np.median(deflection[:end])),
        _noise(deflection[:end]),
        _noise(torque[:end]),
    )


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
    return NoiseFloor(
        no_load[0],
        no_load[1],
        bias,
        float(torque[inside].std()),
        limit,
        float(rest.mean()) if rest.size else math.nan,
    )


def leaves_floor(torque: np.ndarray, floor: NoiseFloor) -> np.ndarray:
    """Return from which sample on the torque has shown itself above its noise floor."""
    return np.maximum.accumulate(np.abs(torque - floor.bias)) > 2.0 * floor.limit


def _gear(table: RecordingTable) -> tuple[float, float]:
    columns, signals = table.columns, table.signal_map.signals
    if not {"link_position", "motor_position"} <= columns.keys() or signals.motor_position is None:
        return math.nan, math.nan
    motor, link = columns["motor_position"], columns["link_position"]
    moved = motor - motor.mean()
    if not moved.any() or np.ptp(link) == 0.0:
        return math.nan, math.nan
    # The motor's encoder behind its gear is the finer of the two: link over motor is the less attenuated slope.
    factor = float(moved @ moved / (moved @ (link - link.mean())))
    return factor, factor * signals.motor_position.gear_ratio


def _describe(line: Characteristic) -> str:
    share = f"a line explains {100 * line.r_squared:.4g} % of the torque's variance"
    span = 2.0 * max((level.amplitude for level in line.levels), default=0.0)
    if abs(line.shift) > _MOVES * span:
        share += (
            f"; at one torque the deflection moved by {1e3 * line.shift:.3g} mrad from start to end: "
            "hysteresis, or something slipped"
        )
    if line.is_line:
        return share
    if not line.causes:
        return f"{share}. What is left is neither a curve nor hysteresis: noise, or errors of the torque signal"
    found = ", ".join(line.causes).upper()
    loop = trend = ""
    if "hysteresis" in line.causes:
        loop = f", a loop {line.width:.3g} N·m wide, loss factor {line.loss_factor:.2g}"
    if "hysteresis" in line.causes and line.swings:
        first, last = line.swings[0], line.swings[-1]
        trend = (
            f"; swings of {first.amplitude:.3g} rad have a secant of {first.secant:.4g} N·m/rad, "
            f"of {last.amplitude:.3g} rad {last.secant:.4g}"
        )
    elif line.causes:
        near, far = line.levels[0], line.levels[-1]
        trend = (
            f"; the tangent goes from {near.tangent:.4g} N·m/rad about rest "
            f"to {far.tangent:.4g} at {far.amplitude:.3g} rad"
        )
    return f"ONE STIFFNESS DOES NOT DESCRIBE THIS LOG: {share}. {found}{loop}{trend}"


def _describe_floor(floor: NoiseFloor) -> str:
    after = ""
    if math.isfinite(floor.share_within):
        after = f"; {100 * floor.share_within:.4g} % of the other samples lie within"
    return (
        f"noise floor of the torque without load, {floor.start:g} to {floor.end:g} s: "
        f"{floor.bias:.3g} ± {floor.limit:.3g} N·m (99.9 %){after}"
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
