"""What link, motor and deflection say of each other: a gear ratio that is another, a drive that does not give."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from tuning.logs.curves import fit, powers, thinned
from tuning.logs.findings import Fault
from tuning.logs.signal_map import SignalMap

_EXPLAINS = 0.5
"""What is left of a disagreement, over itself, once a factor on the motor's angle is allowed for: at most this."""
_WRONG = 5e-3
"""Relative error of a gear ratio that is a fault; smaller ones are notes."""
_NOTED = 1e-3
_SPRING = 0.1
"""Share of the deflection's variance that the torque may leave once the ratio is mended."""
_RIGID = 1e-9
"""Deflection over the motion of the motor, below which the drive does not give at all."""


def gear_factor(columns: Mapping[str, np.ndarray]) -> float:
    """Return the turns of the motor, as mapped, for one of the link, that make the angles agree best.

    Link minus motor is a deflection, which is another signal or a curve of the torque, plus a share of the motor's
    angle that is zero where the ratio is right. A soft spring that a heavy link hangs on bends by much, and with
    the motor: without the deflection or the torque, nothing would tell that from a wrong ratio.

    Args:
        columns: in SI, by canonical name.

    Returns:
        1 where the ratio is right; NaN without link, motor, and deflection or elastic torque.
    """
    share, _ = _motor_share(columns)
    return 1.0 / (1.0 + share) if share > -1.0 else math.nan


def _motor_share(columns: Mapping[str, np.ndarray]) -> tuple[float, bool]:
    """Return the share of the motor's angle in link minus motor beside the deflection, and whether it is clear."""
    if not {"link_position", "motor_position"} <= columns.keys():
        return math.nan, False
    link, motor = columns["link_position"], columns["motor_position"]
    if not (np.ptp(motor) > 0.0 and np.ptp(link) > 0.0):
        return math.nan, False
    bent = link - motor
    if "deflection" in columns and np.ptp(columns["deflection"]) > 0.0:
        (bent, moved) = thinned(bent - columns["deflection"], motor)
        torque, known = None, [np.ones_like(moved)]
    elif "elastic_torque" in columns and np.ptp(columns["elastic_torque"]) > 0.0:
        bent, moved, torque = thinned(bent, motor, columns["elastic_torque"])
        known = powers(torque, 3)
    else:
        return math.nan, False
    before, apart = fit(known, bent), fit(known, moved)
    if not float(apart @ apart) > 1e-12 * moved.size * float(np.var(moved)):
        return math.nan, False
    share = float(apart @ before) / float(apart @ apart)
    after = before - share * apart
    is_clear = float(np.std(after)) < _EXPLAINS * float(np.std(before))
    if torque is not None:
        # A link that hardly moves apart from its motor is as well one that is held: then the torque tells.
        mended = bent - share * moved
        is_clear = is_clear and float(np.var(after)) < _SPRING * float(np.var(mended))
    return share, is_clear


def find_gear(signal_map: SignalMap, columns: Mapping[str, np.ndarray]) -> list[Fault]:
    """Return the fault of a gear ratio at which link and motor do not agree.

    Args:
        signal_map: what the user said.
        columns: in SI, by canonical name.
    """
    share, is_clear = _motor_share(columns)
    mapped = signal_map.signals.motor_position
    if not is_clear or mapped is None or not share > -1.0 or abs(share) < _NOTED:
        return []
    ratio = mapped.gear_ratio / (1.0 + share)
    said = (
        f"agrees with the link_position at a gear ratio of {ratio:.6g}, "
        f"{100 * (ratio / mapped.gear_ratio - 1.0):+.2g} % from {mapped.gear_ratio:.6g}"
    )
    fix = f"Check signals.motor_position.gear_ratio, counts_per_revolution and scale: is the ratio {ratio:.6g}?"
    severity = "fault" if abs(share) > _WRONG else "note"
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
