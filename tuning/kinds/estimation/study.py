"""Studies of an estimator on a joint that is driven."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np

from tuning.files.errors import Mistake, input_error
from tuning.study.base import Config, Timed
from tuning.study.loading import load_study
from tuning.study.parts.base import AtLeastOne, Part, Positive
from tuning.study.parts.estimators import AlgebraicObserver, AntagonisticPair
from tuning.study.parts.joints import JOINTS
from tuning.study.parts.rig import BandLimitedNoise, Excitation, Sensing
from tuning.study.ranges import EVERYTHING, Reach

_TORQUES = {"motor_torque", "motor1_torque", "motor2_torque", "elastic_torque"}
_LAG = "torque.observer_gain"


class EstimationStudy(Timed, Config):
    """A study of an estimator on a joint that is driven."""

    varied: ClassVar[tuple[str, ...]] = ("joint", "excitation", "sensing", "estimator", "scorer", "clock")
    presets: ClassVar[Mapping[str, str]] = {"joint": "joints"}
    excitation: Excitation = Excitation()
    sensing: Sensing
    integration_tolerance: Positive = 1e-7
    substeps: AtLeastOne | None = None

    def substeps_set(self) -> int | None:
        """Return the integration steps a sample that the study sets."""
        return self.substeps

    def tones(self) -> int:
        """Return how many sines drive the joint."""
        return sum(profile.tones for _, profile in self.excitation if isinstance(profile, BandLimitedNoise))

    def reach(self, path: str) -> Reach:
        """Return what the number at a path changes at most."""
        table, _, rest = path.partition(".")
        if table not in {"estimator", "sensing", "scorer"}:
            return EVERYTHING
        part = rest.removeprefix("side.").removeprefix("other.") if table == "estimator" else rest
        # What a foreign estimator calls its torque may be anything.
        is_torque = (
            part.startswith("torque.") and self.estimator.origin is None and not self._lags(part)
            if table == "estimator"
            else part.partition(".")[0] in _TORQUES
        )
        found = Reach.TORQUE if is_torque else Reach.TORQUE | Reach.REGRESSORS
        return found if table == "estimator" else found | Reach.RECORDING

    def _lags(self, part: str) -> bool:
        """Return whether a number of the estimator is the lag that its features share with its torque."""
        both = (self.estimator.side, self.estimator.other) if isinstance(self.estimator, AntagonisticPair) else ()
        return part == _LAG and any(getattr(side, "matched", False) for side in (self.estimator, *both))

    def mistakes(self, place: str) -> Iterator[Mistake]:
        """Return what is wrong of the estimator with this joint, these sensors and this clock."""
        for name in sorted(self.estimator.needs):
            if getattr(self.sensing, name) is None:
                yield Mistake(
                    f"{place}: sensing.{name}",
                    "is missing, but the estimator needs this signal",
                    f"add a [sensing.{name}] table, or choose another torque, deflection or basis",
                )
        yield from check_pairing(self, place)
        yield from _check_windows(self, place)
        warm_up, duration = self.scorer.warm_up, self.clock.duration
        if self.tune.objective == "msrep_settled" and warm_up >= duration:
            problem = f"got {warm_up} s; no sample of {duration} s is left for tune.objective"
            yield Mistake(f"{place}: scorer.warm_up", problem, "record for longer, or warm up for less")


class SerialStudy(EstimationStudy):
    """A study of a serial adjustable-stiffness joint."""

    joint: Annotated[Part, JOINTS.only("serial")]


class SeaStudy(EstimationStudy):
    """A study of a series-elastic actuator: one motor, one spring."""

    joint: Annotated[Part, JOINTS.only("sea")]


class AntagonisticStudy(EstimationStudy):
    """A study of an agonist-antagonist joint: two motors, two springs, an estimator a side."""

    joint: Annotated[Part, JOINTS.only("antagonistic")]


def load_estimation(path: Path, settings: Sequence[str] = ()) -> EstimationStudy:
    """Return the study of an estimator in a TOML file; as `load_study`, and any other kind is refused."""
    study = load_study(path, settings)
    if not isinstance(study, EstimationStudy):
        raise input_error(
            f"{path}: kind", f"got {study.kind!r}, which estimates nothing", "name an estimator's study"
        )
    return study


def check_pairing(config: Config, place: str) -> list[Mistake]:
    """Return the mistake of a pair of estimators on a joint with one transmission, or the reverse."""
    is_pair, wants_pair = isinstance(config.estimator, AntagonisticPair), config.kind == "antagonistic"
    if is_pair == wants_pair:
        return []
    fix = (
        'set it to "pair" and move its tables below [estimator.side]'
        if wants_pair
        else "name one side's estimator"
    )
    got = config.estimator.tag
    return [Mistake(f"{place}: estimator.type", f"got {got!r}, which does not fit kind {config.kind!r}", fix)]


def _check_windows(study: EstimationStudy, place: str) -> list[Mistake]:
    """Check the moving windows of algebraic observers against the clock and the ranges they are varied over."""
    mistakes = []
    varied = study.sweep.grid.keys() | study.tune.parameters.keys()
    for path, observer in observers_of(study.estimator, "estimator"):
        if observer.sample_time != study.clock.sample_time:
            problem = f"got {observer.sample_time}, but clock.sample_time is {study.clock.sample_time}"
            mistakes.append(Mistake(f"{place}: {path}.sample_time", problem, "make them equal"))
        if study.clock.jitter_std is not None:
            problem = "an algebraic observer needs a regular clock"
            mistakes.append(Mistake(f"{place}: clock.jitter_std", problem, "remove it"))
        if f"{path}.window" in varied and observer.longest_window is None:
            problem = "is missing, but the window is varied"
            mistakes.append(Mistake(f"{place}: {path}.longest_window", problem, "set it to the longest of them"))
        if f"{path}.window" in study.tune.parameters and observer.quadrature != "product":
            problem = f"got {observer.quadrature!r}, which rounds the window to samples, but the window is tuned"
            mistakes.append(Mistake(f"{place}: {path}.quadrature", problem, 'set it to "product"'))
    return mistakes


def observers_of(estimator: Part, path: str) -> Iterator[tuple[str, AlgebraicObserver]]:
    """Return the algebraic observers of an estimator, each with its path."""
    if isinstance(estimator, AlgebraicObserver):
        yield path, estimator
    elif isinstance(estimator, AntagonisticPair):
        yield from observers_of(estimator.side, f"{path}.side")
        if estimator.other is not None:
            yield from observers_of(estimator.other, f"{path}.other")


def require_regular_clock(config: Config, time: np.ndarray, source: str) -> None:
    """Refuse times that do not tick as an algebraic observer's moving window needs.

    Args:
        config: with the estimator.
        time: of the samples [s].
        source: where they come from, for errors.

    Raises:
        InputError: a step differs from the observer's sample time by more than a hundredth.
    """
    steps = np.diff(time)
    for path, observer in observers_of(config.estimator, "estimator"):
        if np.max(np.abs(steps - observer.sample_time), initial=0.0) > 0.01 * observer.sample_time:
            raise input_error(
                f"{source}: time",
                f"steps by {1e3 * steps.min():.4g} to {1e3 * steps.max():.4g} ms, but {path} (algebraic) needs a "
                f"sample every {1e3 * observer.sample_time:.4g} ms, its sample_time",
                f'set clock.resample = "linear", clock.sample_time = {observer.sample_time:g} in the signal map',
            )
