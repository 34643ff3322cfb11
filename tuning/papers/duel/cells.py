"""What meets in the duel, and what is known of each meeting."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from tuning.files.shipped import example_path
from tuning.kinds.estimation.study import EstimationStudy, load_estimation
from tuning.papers.antagonistic import model as paper
from tuning.study.ranges import Bounds

SETTINGS = (paper.R1, paper.R2, paper.T1)
LEVELS = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2)
"""Standard deviations of the noise on every position [rad]."""
TRAIN, HELD_OUT = 16, 64
SIDE = "estimator.side."
"""Where the paths of an estimator's numbers begin."""
SENSORS = ("link_position", "motor1_position", "motor2_position")
"""Whose noise is the level."""


@dataclass(frozen=True)
class Contender:
    """One estimator in the duel.

    Args:
        name: its label.
        family: "algebraic" or "residual".
        side: the settings of its `[estimator.side]`.
        bounds: what is tuned of it, by path; empty where it is taken as given.
    """

    name: str
    family: str
    side: tuple[str, ...]
    bounds: Mapping[str, Bounds] = field(default_factory=dict, hash=False)

    @cached_property
    def study(self) -> EstimationStudy:
        """The antagonistic example with this estimator."""
        plain = ["sweep={}", "tune={}", f"scenarios={{train={TRAIN}, held_out={HELD_OUT}}}"]
        return load_estimation(example_path("antagonistic", "antagonistic"), [*plain, *self.side])

    @property
    def has_filter(self) -> bool:
        """Whether a Kalman filter smooths its positions; its reading variance is that of the noise."""
        return any("kalman" in setting for setting in self.side)


_KALMAN = (
    '{{type="kalman", acceleration_variance={}, reading_variance=1e-6, start_position_variance=1e-6, '
    "start_velocity_variance=100.0}}"
)
_VARIANCE = {f"{SIDE}velocity.acceleration_variance": Bounds(low=1e-2, high=1e7)}
_WINDOW = {
    f"{SIDE}window": Bounds(low=0.1, high=1.9),
    f"{SIDE}fit.prior_scale": Bounds(low=1e4, high=1e18),
}
_OBSERVER = {
    f"{SIDE}torque.observer_gain": Bounds(low=3.0, high=1500.0),
    f"{SIDE}fit.prior_scale": Bounds(low=1e-2, high=1e10),
}


def _residual(basis: str, acceleration_variance: float) -> tuple[str, ...]:
    return (
        f'estimator.side={{type="two_stage", matched=false, fit={{prior_scale=1e6}}, basis={basis}, '
        f"velocity={_KALMAN.format(acceleration_variance)}, "
        'torque={type="residual", observer_gain=1e3, motor_inertia=1e-4, motor_damping=1.27}}',
    )


def _algebraic(settings: str, acceleration_variance: float | None = None) -> tuple[str, ...]:
    velocity = "" if acceleration_variance is None else f"velocity={_KALMAN.format(acceleration_variance)}, "
    return (
        'estimator.side={type="algebraic", motor_inertia=1e-4, motor_damping=1.27, sample_time=1e-3, window=1.0, '
        f'longest_window=2.0, basis={{type="taylor", order=2}}, fit={{prior_scale=1e10}}, {velocity}{settings}}}',
    )


_PRINTED = 'weighting="continuous", scaling="printed", quadrature="trapezoid"'
_SCALE_FREE = 'scaling="scale_free", quadrature="product"'
_ODD, _CONSTANT = '{type="odd", deflection_terms=4}', '{type="polynomial", order=3}'
CONTENDERS = (
    Contender("algebraic, as printed", "algebraic", _algebraic(_PRINTED)),
    Contender("algebraic, tuned, unfiltered", "algebraic", _algebraic(_SCALE_FREE), _WINDOW),
    Contender("algebraic, tuned", "algebraic", _algebraic(_SCALE_FREE, 1e3), _WINDOW | _VARIANCE),
    Contender("residual, as given", "residual", _residual(_ODD, 1e5)),
    Contender("residual, tuned, odd basis", "residual", _residual(_ODD, 1e3), _OBSERVER | _VARIANCE),
    Contender("residual, tuned, with constant", "residual", _residual(_CONSTANT, 1e3), _OBSERVER | _VARIANCE),
)


@dataclass(frozen=True)
class Cell:
    """One excitation at one noise level.

    Args:
        setting: name of the excitation.
        level: noise on every position [rad].
        mse: of each contender: mean over the held-out draws and its 95 % interval [(N·m/rad)²].
        msrep: the same of the relative error [%].
        residual: the name of the residual estimator with the better basis on the training draws.
        ratios: mean MSE of the tuned residual estimator over that of another, by the other's name: value and
            paired 95 % interval.
        msrep_ratio: the same of MSREP, over the tuned algebraic observer's.
    """

    setting: str
    level: float
    mse: dict[str, tuple[float, float, float]]
    msrep: dict[str, tuple[float, float, float]]
    residual: str
    ratios: dict[str, tuple[float, float, float]]
    msrep_ratio: tuple[float, float, float]


PRINTED, UNFILTERED, ALGEBRAIC, GIVEN, ODD, CONSTANT = (contender.name for contender in CONTENDERS)
