"""What is wrong with torque over deflection as a whole: late, offset, of the wrong sign, or unrelated."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tuning.logs.curves import (
    curve_of,
    explains,
    fit,
    is_smooth,
    least_of,
    left_over,
    powers,
    thinned,
    white_share,
)
from tuning.logs.findings import Fault
from tuning.logs.signal_map import SignalMap

_DEGREE = math.pi / 180.0
_OPPOSITE = -0.9
"""Correlation from which a torque falls as the deflection rises; a weaker one may have any cause."""
_LONGEST_DELAY = 0.25
"""In seconds, and at most a twentieth of the log."""
_DELAYS = 24
_EXPLAINS = 0.3
"""What a cause leaves of what was unexplained, at most."""
_VISIBLE = 2e-4
"""Share of the torque's variance below which nothing is looked for."""
_HARMFUL = 1e-3
_FEWEST = 100
_OFFSET = 0.02
"""Share of the torque's range from which an offset counts."""
_CURVE = 0.05
"""Share of the torque's variance that a curve leaves at most once the delay is undone."""
_UNRELATED = 0.5
_FEWEST_COUNTS = 40
"""Levels of the deflection up to which its rounding is seen in what a curve leaves."""
_WRONG_WAY = -0.02
"""Loss factor below which a loop is said to turn the wrong way."""


@dataclass(frozen=True)
class Assumptions:
    """What an estimator takes for granted of a log.

    Args:
        torque: where its torque comes from: "sensor", "model", "residual", "algebraic", or a foreign tag.
        is_matched: whether its features lag as its torque does.
        has_friction: whether it knows the motor's dry friction.
        has_offset: whether its fit has a constant.
    """

    torque: str = "sensor"
    is_matched: bool = True
    has_friction: bool = True
    has_offset: bool = True

    @property
    def is_measured(self) -> bool:
        """Whether a sensor reads the torque; else what is wrong with it may be the estimator's numbers."""
        return self.torque == "sensor"


def judge_stiffness(stiffness: float, signal_map: SignalMap, correlation: float) -> list[Fault]:
    """Return the faults that a stiffness shows: it is negative, or not what is known of the joint.

    Args:
        stiffness: least-squares slope of torque over deflection [N.m/rad].
        signal_map: with what the user expects.
        correlation: of torque and deflection.
    """
    expected = signal_map.expect.stiffness
    if correlation < _OPPOSITE:
        said = f"falls as the deflection rises: {stiffness:.4g} N·m/rad, correlation {correlation:.3f}"
        fix = (
            "Set sign = -1 on one of the two: the deflection is link minus motor, the torque grows with it. "
            "Or is the deflection another angle, as that of the joint under gravity?"
        )
        return [Fault("swapped sign", "torque", said, fix)]
    if expected is None or expected[0] <= stiffness <= expected[1]:
        return []
    said = f"makes {stiffness:.4g} N·m/rad where expect.stiffness is {expected}"
    for factor, fix in (
        (1.0 / _DEGREE, 'The deflection is in degrees, taken for radians: set unit = "deg"?'),
        (_DEGREE, 'The deflection is in radians, taken for degrees: set unit = "rad"?'),
    ):
        if expected[0] <= stiffness * factor <= expected[1]:
            return [Fault("degrees for radians", "deflection", said, fix)]
    return [
        Fault("out of range", "stiffness", said, "Check units, scales and gear ratios, or widen what is expected")
    ]


def find_delay(
    time: np.ndarray, deflection: np.ndarray, torque: np.ndarray, setpoint: np.ndarray | None, given: Assumptions
) -> list[Fault]:
    """Return the fault of a torque that goes with the deflection of another instant.

    Over all delays, that is sought at which a smooth curve leaves the least of the torque. Dry friction in the
    spring makes a loop too, but hardly any delay undoes it.

    Args:
        time: [s].
        deflection: lagging as the torque does [rad].
        torque: [N·m].
        setpoint: moves the curve, where there is one.
        given: of the estimator.
    """
    if not _can_be_judged(torque):
        return []
    kept = thinned(time, torque, *([] if setpoint is None else [setpoint]))
    moment, wanted = kept[:2]
    moves = kept[2] if setpoint is not None else None
    step = float(np.median(np.diff(time)))
    longest = min(_LONGEST_DELAY, 0.05 * float(time[-1] - time[0]))
    inside = (moment > time[0] + longest) & (moment < time[-1] - longest)
    if np.count_nonzero(inside) < _FEWEST or longest < 2.0 * step:
        return []
    moment, wanted = moment[inside], wanted[inside]
    moves = None if moves is None else moves[inside]

    def left(delay: float) -> float:
        shifted = np.interp(moment - delay, time, deflection)
        return left_over(curve_of(shifted, moves, order=3), wanted)

    now = left(0.0)
    if now < _VISIBLE:
        return []
    # The square root of a share is near its least as |delay − best|: the finest steps are the shortest delays.
    tried = longest * np.linspace(-1.0, 1.0, 2 * _DELAYS + 1) ** 3
    shares = np.array([left(float(delay)) for delay in tried])
    at = int(np.argmin(shares))
    if at in (0, tried.size - 1):
        return []
    best = least_of(left, float(tried[at - 1]), float(tried[at + 1]))
    then = left(best)
    # Who is shifted far enough goes with anything that swings: it must also be a curve then.
    is_curve = then < _CURVE
    if abs(best) < step or not is_curve or not explains(now, then, white_share(wanted), least=_EXPLAINS):
        return []
    others = " or wrong numbers of the motor in estimator.torque" if not given.is_measured else ""
    said = f"the deflection by {1e3 * abs(best):.3g} ms: so shifted, a curve leaves {100 * then:.2g} % of it"
    said += f" instead of {100 * now:.2g} %"
    if best > 0.0:
        said = f"comes after {said}"
        fix = (
            f"Do both have one clock? A filter, a bus or another stamp makes it late{others}. Mend its time stamps"
        )
        return [Fault("late torque", "torque", said, fix, "fault" if now > _HARMFUL else "note")]
    said = f"comes before {said}"
    fix = f"The deflection is late (a filter, a bus, another stamp), or the spring has damping or friction{others}"
    return [Fault("early torque", "torque", said, fix, "note")]


def find_lag(
    deflection: np.ndarray,
    lagging: np.ndarray,
    torque: np.ndarray,
    setpoint: np.ndarray | None,
    given: Assumptions,
) -> list[Fault]:
    """Return the note on a fit to the deflection itself of a torque that lags.

    Args:
        deflection: [rad].
        lagging: as the torque [rad].
        torque: of an observer [N·m].
        setpoint: moves the curve, where there is one.
        given: of the estimator.
    """
    if given.is_matched or not float(np.var(torque)) > 0.0:
        return []
    own, lagged = (left_over(curve_of(x, setpoint, order=3), torque) for x in (deflection, lagging))
    if own < _HARMFUL or lagged > _EXPLAINS * own:
        return []
    said = (
        f"lags as its observer does: over the deflection itself a curve leaves {100 * own:.2g} % of it, "
        f"over one that lags as much {100 * lagged:.2g} %"
    )
    fix = "Set estimator.matched = true, or raise estimator.torque.observer_gain"
    return [Fault("lagging observer", "torque", said, fix, "note")]


def find_offset(
    deflection: np.ndarray, torque: np.ndarray, setpoint: np.ndarray | None, given: Assumptions
) -> list[Fault]:
    """Return the fault of a torque that is not zero at zero deflection where the fit has no term for that.

    Args:
        deflection: [rad].
        torque: [N·m].
        setpoint: moves the curve, where there is one.
        given: of the estimator.
    """
    reach = float(np.abs(deflection).max())
    if given.has_offset or not reach > 0.0 or not _can_be_judged(torque):
        return []
    scaled = deflection / reach
    factors = powers(setpoint, 2) if setpoint is not None and np.ptp(setpoint) > 0.0 else [np.ones_like(scaled)]
    odd = [factor * scaled**power for factor in factors for power in (1, 3, 5)]
    without = fit(odd, torque)
    constant = np.ones_like(scaled)
    apart = fit(odd, constant)
    if not float(apart @ apart) > 1e-6 * scaled.size:
        return []
    offset = float(apart @ torque) / float(apart @ apart)
    left = without - offset * apart
    matters = abs(offset) > _OFFSET * float(np.ptp(torque)) and float(np.mean(without**2)) > _HARMFUL * float(
        np.var(torque)
    )
    if not matters or float(np.mean(left**2)) > _EXPLAINS * float(np.mean(without**2)):
        return []
    said = (
        f"is {offset:.4g} N·m at zero deflection, {100 * abs(offset) / float(np.ptp(torque)):.2g} % of its range, "
        "and the fit has no term for it"
    )
    fix = (
        "Set estimator.basis.torque_bias = true (or deflection_offset = true, where the zero of an angle is "
        'arbitrary; type = "polynomial" has it), or take the offset out in the signal map'
    )
    return [Fault("torque offset", "torque", said, fix)]


def find_unrelated(
    deflection: np.ndarray, torque: np.ndarray, setpoint: np.ndarray | None, given: Assumptions
) -> list[Fault]:
    """Return the fault of a torque that no curve of the deflection explains, though it is no noise.

    Args:
        deflection: [rad].
        torque: [N·m].
        setpoint: moves the curve, where there is one.
        given: of the estimator.
    """
    if not _can_be_judged(torque):
        return []
    left = fit(curve_of(deflection, setpoint), torque)
    share = float(np.var(left)) / float(np.var(torque))
    if share < _UNRELATED or not is_smooth(left):
        return []
    said = f"hardly goes with the deflection: a curve explains {100 * (1.0 - share):.2g} % of it"
    if given.is_measured:
        fix = "Is the deflection link minus motor, not the joint's angle, and the torque that of the same joint?"
        return [Fault("unrelated torque", "torque", said, fix)]
    fix = "Do the estimator's inertia, damping, friction and gear ratio fit this motor, and its torque this joint?"
    return [Fault("unrelated torque", "torque", said, fix, "note")]


def find_coarse(deflection: np.ndarray) -> list[Fault]:
    """Return the note on a deflection of so few counts that their rounding is seen in every loop and bend.

    Args:
        deflection: as the fit has it [rad].
    """
    span = float(np.ptp(deflection))
    # Differences of two encoders of one count round to its multiples but for the last digits.
    levels = np.unique(np.round(deflection / span, 9)).size if span > 0.0 else 0
    if not 1 < levels <= _FEWEST_COUNTS:
        return []
    said = f"moves by {levels - 1} counts of {1e3 * span / (levels - 1):.3g} mrad in all"
    fix = "Its rounding alone can make loops and bends: excite the joint more, or measure it more finely"
    return [Fault("coarse deflection", "deflection", said, fix, "note")]


def find_negative_loop(loss_factor: float, branches: float, given: Assumptions) -> list[Fault]:
    """Return the note on a loop that turns the wrong way: a spring would give out energy.

    Args:
        loss_factor: of the loop.
        branches: share of what a line leaves that loading and unloading explain.
        given: of the estimator.
    """
    if not (loss_factor < _WRONG_WAY and branches > 0.1):
        return []
    said = f"over deflection makes a loop that turns the wrong way, loss factor {loss_factor:.2g}"
    other = "" if given.is_measured else ", or the motor's friction or inertia in the estimator is wrong"
    fix = f"No spring gives out energy: the two are not of one instant, or a zero moved{other}"
    return [Fault("negative loop", "torque", said, fix, "note")]


def _can_be_judged(torque: np.ndarray) -> bool:
    """Return whether there are enough samples of a torque, and it moves."""
    return torque.size >= _FEWEST and float(np.var(torque)) > 0.0
