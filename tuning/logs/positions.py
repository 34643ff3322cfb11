"""What link, motor and deflection say of each other: a gear ratio that is another, a drive that does not give."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from tuning.logs.curves import explains, least_of, left_over, powers, thinned, white_share
from tuning.logs.findings import Fault
from tuning.logs.signal_map import SignalMap

_EXPLAINS = 0.5
"""What is left of a disagreement, over itself, once another ratio is allowed for: at most this."""
_WRONG = 5e-3
"""Relative error of a gear ratio that is a fault; smaller ones are notes."""
_NOTED = 1e-3
_WIDEST = 5.0
"""Logarithm of the largest factor that is tried: about 150."""
_RIGID = 1e-9
"""Deflection over the motion of the motor, below which the drive does not give at all."""


def gear_factor(columns: Mapping[str, np.ndarray]) -> float:
    """Return the turns of the motor, as mapped, for one of the link, that make the angles agree best.

    Args:
        columns: in SI, by canonical name.

    Returns:
        1 where the ratio is right; NaN without link, motor, and deflection or elastic torque.
    """
    return _agreement(columns)[0]


def _agreement(columns: Mapping[str, np.ndarray]) -> tuple[float, bool]:
    """Return the factor at which link and motor agree best, and whether it is clear that 1 is wrong."""
    if not {"link_position", "motor_position"} <= columns.keys():
        return math.nan, False
    link, motor = columns["link_position"], columns["motor_position"]
    if not (link.size and np.ptp(motor) > 0.0 and np.ptp(link) > 0.0):
        return math.nan, False
    if "deflection" in columns and np.ptp(columns["deflection"]) > 0.0:
        return _by_deflection(link, motor, columns["deflection"])
    if "elastic_torque" in columns and np.ptp(columns["elastic_torque"]) > 0.0:
        return _by_torque(*thinned(link, motor, columns["elastic_torque"]))
    return math.nan, False


def _by_deflection(link: np.ndarray, motor: np.ndarray, deflection: np.ndarray) -> tuple[float, bool]:
    """Return the factor by what link minus motor, less the measured deflection, has of the motor's angle."""
    left, moved = (x - x.mean() for x in (link - motor - deflection, motor))
    share = float(moved @ left) / float(moved @ moved)
    is_clear = float(np.std(left - share * moved)) < _EXPLAINS * float(np.std(left))
    return (1.0 / (1.0 + share), is_clear) if share > -1.0 else (math.nan, False)


def _by_torque(link: np.ndarray, motor: np.ndarray, torque: np.ndarray) -> tuple[float, bool]:
    """Return the factor at which the torque is most nearly a curve of the deflection.

    A soft spring that a heavy link hangs on bends by much, and with the motor: the angles alone would take that
    for another ratio. Where the link is held, or follows the motor at a fixed share, every ratio gives one curve.
    """

    def left(log_factor: float) -> float:
        return left_over(powers(link - motor / math.exp(log_factor), 3), torque)

    now, noise = left(0.0), white_share(torque)
    tried = np.linspace(-_WIDEST, _WIDEST, 61)
    shares = [left(float(x)) for x in tried]
    at = int(np.argmin(shares))
    low, high = (float(tried[max(0, min(tried.size - 1, at + i))]) for i in (-1, 1))
    best = least_of(left, low, high)
    return math.exp(best), explains(now, left(best), noise, least=_EXPLAINS**2)


def find_gear(signal_map: SignalMap, columns: Mapping[str, np.ndarray]) -> list[Fault]:
    """Return the fault of a gear ratio at which link and motor do not agree.

    Args:
        signal_map: what the user said.
        columns: in SI, by canonical name.
    """
    factor, is_clear = _agreement(columns)
    mapped = signal_map.signals.motor_position
    if not is_clear or mapped is None or abs(factor - 1.0) < _NOTED:
        return []
    ratio = mapped.gear_ratio * factor
    said = (
        f"agrees with the link_position at a gear ratio of {ratio:.6g}, "
        f"{100 * (factor - 1.0):+.3g} % from {mapped.gear_ratio:.6g}"
    )
    fix = f"Check signals.motor_position.gear_ratio, counts_per_revolution and scale: is the ratio {ratio:.6g}?"
    severity = "fault" if abs(factor - 1.0) > _WRONG else "note"
    return [Fault("wrong gear ratio", "motor_position", said, fix, severity)]


def find_rigid(signal_map: SignalMap, columns: Mapping[str, np.ndarray]) -> list[Fault]:
    """Return the fault of link and motor that move as one where no signal measures the deflection.

    A note where the map says that nothing loads the joint: then nobody wants a stiffness of it.

    Args:
        signal_map: what the user said.
        columns: in SI, by canonical name.
    """
    if "deflection" in columns or not {"link_position", "motor_position"} <= columns.keys():
        return []
    link, motor = columns["link_position"], columns["motor_position"]
    bent, moved = float(np.ptp(link - motor)), float(np.ptp(motor))
    if not moved > 0.0 or bent > _RIGID * moved:
        return []
    value = float(np.median(link - motor))
    said = f"(link minus motor) is {value:.6g} rad in every sample, though the motor moves by {moved:.4g} rad"
    fix = (
        "Are both mapped to one encoder? Map one on each side of the spring, or a deflection; "
        "a drive without a spring between them has no stiffness to estimate"
    )
    severity = "fault" if signal_map.expect.no_load is None else "note"
    return [Fault("rigid drive", "deflection", said, fix, severity)]
