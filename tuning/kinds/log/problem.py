"""A study of a log made computable: how well an estimator's torque agrees with a part of a robot's recording."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from tuning.kinds.log.recording import read_log
from tuning.kinds.log.study import LogStudy
from tuning.logs.reading import RecordingTable
from tuning.problem.build import build_estimator, with_leaves
from tuning.problem.interface import Outcome, Scenario, Status, Stream, Values
from tuning.problem.scenarios import draw_scenarios
from vsajax import Recording, rollout
from vsajax.experiments import estimation
from vsajax.rollout.sensitivity import Loop
from vsajax.types import Scalar

_HELD_OUT = "held_out"


class Given(NamedTuple):
    """What a study's programs are given: what dotted paths lead into, and the log.

    Args:
        estimator: at the study's own numbers.
        recording: the log.
        is_training: which samples are tuned on.
    """

    estimator: Any
    recording: Recording
    is_training: Bool[Array, " time"]


class LogScores(NamedTuple):
    """Scores of an estimator on a part of a log.

    Args:
        agreement: 1 − ρ² of torque and deflection, which lags as the torque does [%].
        no_load: mean square of the torque, over that of the motor's at the joint [%]; NaN where none is measured.
        rest: the study's objective on the rest of the log [%].
        diverged: 1 where the objective is not finite, else 0.
    """

    agreement: Float[Array, "..."]
    no_load: Float[Array, "..."]
    rest: Float[Array, "..."]
    diverged: Float[Array, "..."]


@dataclass(frozen=True)
class LogProblem:
    """A study's log, and the scores of its two parts as pure functions of varied numbers.

    Args:
        study: the study.
        varied: dotted paths of the numbers that will vary.

    Raises:
        InputError: see `read_log`.
    """

    study: LogStudy
    varied: tuple[str, ...] = ()
    # Each holds its signals whole.
    lanes: ClassVar[int] = rollout.LANES_PER_CHUNK

    def __post_init__(self) -> None:
        """Read the log, so that what is wrong with it is told before anything is written."""
        _ = self.table

    @cached_property
    def table(self) -> RecordingTable:
        """The log as it was read."""
        return read_log(self.study)

    @property
    def samples(self) -> int:
        """How much work a scenario is: the samples of the log."""
        return len(self.table.columns["time"])

    @cached_property
    def given(self) -> Given:
        """What the functions below are given."""
        columns = self.table.columns
        recording = Recording(
            **{name: jnp.asarray(columns[name]) for name in Recording._fields if name in columns}
        )
        is_training = recording.time <= self.study.recording.train_until
        return Given(build_estimator(self.study), recording, is_training)

    def scenarios(self, stream: Stream, count: int, start: int = 0) -> Scenario:
        """Return the part of the log that a stream stands for, `(count,)` times."""
        drawn = draw_scenarios(self.study, stream, count, start)
        return drawn._replace(numbers={_HELD_OUT: jnp.full(count, stream == "held_out")})

    def signals(self, values: Values, given: Given) -> tuple[Float[Array, " time"], Float[Array, " time"]]:
        """Return the torque that is explained [N·m], and the deflection that lags as it does [rad]."""
        return estimation.agreement(with_leaves(given, values).estimator, given.recording)

    def outcome(self, values: Values, scenario: Scenario, given: Given) -> Outcome:
        """Return the scores at `values` on a part of the log, and whether they count."""
        at = with_leaves(given, values)
        torque, deflection = self.signals(values, given)
        share = _share(scenario, given)
        rest = _share(scenario, given._replace(is_training=~given.is_training))

        def score(objective: str, share: Float[Array, " time"]) -> Float[Array, ""]:
            if objective == "no_load" and "motor_torque" not in self.study.estimator.needs:
                return jnp.array(jnp.nan)
            left = _residuals(objective, torque, deflection, at, share)
            return left @ left

        agreement, no_load = (score(name, share) for name in ("agreement", "no_load"))
        own = agreement if self.study.tune.objective == "agreement" else no_load
        is_finite = jnp.isfinite(own)
        scores = LogScores(agreement, no_load, score(self.study.tune.objective, rest), 1.0 - is_finite)
        return Outcome(scores, jnp.where(is_finite, Status.OK, Status.ESTIMATE_DIVERGED))

    def observe(self, values: Values, scenario: Scenario, given: Given) -> Float[Array, " time"]:
        """Return the weight of every sample: what a part of the log is."""
        del values
        return _share(scenario, given)

    def residuals(
        self, values: Values, scenario: Scenario, given: Given, observed: Float[Array, " time"] | None
    ) -> Loop:
        """Return the loop whose residuals' squares sum to the objective on a part of the log [%]."""
        share = self.observe(values, scenario, given) if observed is None else observed
        torque, deflection = self.signals(values, given)
        left = _residuals(self.study.tune.objective, torque, deflection, with_leaves(given, values), share)
        # A line is fitted through all samples before the first residual is known: the loop only adds them up.
        return Loop(_unchanged, (), left)


def _unchanged(state: tuple[()], residual: Scalar) -> tuple[tuple[()], Scalar]:
    return state, residual


def _share(scenario: Scenario, given: Given) -> Float[Array, " time"]:
    """Return the weight of every sample in the means over a part of the log: they sum to 1."""
    chosen = jnp.where(scenario.numbers[_HELD_OUT], ~given.is_training, given.is_training).astype(float)
    return chosen / jnp.sum(chosen)


def _residuals(
    objective: str,
    torque: Float[Array, " time"],
    deflection: Float[Array, " time"],
    given: Given,
    share: Float[Array, " time"],
) -> Float[Array, " time"]:
    """Return the vector whose squared norm is an objective [√%].

    Agreement: what a line over the lagging deflection leaves of the torque, 1 − ρ². No load: the torque, over that
    of the motor at the joint.
    """
    # Apart from the sums below: the root of a quotient of 0 has no derivative.
    weight = 10.0 * jnp.sqrt(share)
    if objective == "no_load":
        drive = given.estimator.torque.gear_ratio * given.recording.motor_torque
        return weight * torque / jnp.sqrt(jnp.sum(share * drive**2))
    torque, deflection = (x - jnp.sum(share * x) for x in (torque, deflection))
    slope = jnp.sum(share * torque * deflection) / jnp.sum(share * deflection**2)
    # A line that falls explains nothing: a spring's torque grows with its deflection.
    left = torque - jnp.maximum(slope, 0.0) * deflection
    return weight * left / jnp.sqrt(jnp.sum(share * torque**2))
