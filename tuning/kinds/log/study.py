"""A study of a log: an estimator, the recording of a robot, and the numbers to tune on it. No jax here."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from tuning.files.errors import Mistake
from tuning.files.toml import Table, validate
from tuning.logs.signal_map import read_signal_map
from tuning.study.base import Config, Scenarios, Study, Sweep, Tune, resolved
from tuning.study.parts.base import Positive
from tuning.study.parts.estimators import StiffnessEstimator
from tuning.study.population import Population
from tuning.study.ranges import Reach
from tuning.study.scores import Objective
from tuning.study.statistic import Statistic


class LoggedRecording(Table):
    """The log that is tuned on.

    Args:
        file: the log.
        map: its signal map.
        select: keep only the rows whose column equals the value.
        train_until: samples up to this time are tuned on, later ones judge [s].
    """

    file: str
    map: str | None = None
    select: dict[str, str | float] = Field(default_factory=dict)
    train_until: Positive


class LogSweep(Sweep):
    """The grid of `vsajax sweep`: a part of a log is one scenario."""

    scenarios: Literal[1] = 1  # pyright: ignore[reportIncompatibleVariableOverride] - the only number there is


class LogTune(Tune):
    """What is varied, and to what end.

    Args:
        objective: "agreement": the torque signal is to be a line over the measured deflection, lagging as the
            torque does; "no_load": nothing loads the joint, the torque signal is to vanish.
        starts: of the gradient; the first is the study itself.
        screen: points tried before.
        max_steps: of a start.
        parameters: bounds by dotted path.
        choices: settings by dotted path, by option, by choice.
    """

    later: ClassVar[frozenset[str]] = frozenset({"choices"})
    statistic: ClassVar[Statistic] = Statistic()  # pyright: ignore[reportIncompatibleVariableOverride] - of one
    objective: Literal["agreement", "no_load"] = "agreement"  # pyright: ignore[reportIncompatibleVariableOverride]
    screen: Annotated[int, Field(ge=1)] = 64


class LogStudy(Study, Config):
    """A configuration with the log that it is tuned on.

    The log is two scenarios, one a stream: what was recorded up to `train_until`, and what came after.
    """

    varied: ClassVar[tuple[str, ...]] = ("estimator",)
    objectives: ClassVar[tuple[Objective, ...]] = ("agreement", "no_load")
    later: ClassVar[frozenset[str]] = frozenset({"sweep"})
    # Nothing is drawn. pyright: these are fields of other studies.
    population: ClassVar[Population] = Population()  # pyright: ignore[reportIncompatibleVariableOverride]
    scenarios: ClassVar[Scenarios] = Scenarios(train=1, held_out=1)  # pyright: ignore[reportIncompatibleVariableOverride]
    recording: LoggedRecording
    sweep: LogSweep = LogSweep()  # pyright: ignore[reportIncompatibleVariableOverride] - never assigned to
    tune: LogTune = LogTune()  # pyright: ignore[reportIncompatibleVariableOverride]

    def no_scenarios(self) -> str:
        """Return why no scenarios are drawn."""
        return "a recording is one, and nothing is drawn"

    def reach(self, path: str) -> Reach:
        """Return what the number at a path changes at most: the log stays as it was recorded."""
        del path
        return Reach.TORQUE | Reach.REGRESSORS

    def mistakes(self, place: str) -> Iterator[Mistake]:
        """Return what is wrong of the estimator: it must have a torque signal, for "no_load" a residual."""
        if not isinstance(self.estimator, StiffnessEstimator):
            problem = f"got {self.estimator.tag!r}, which has no torque signal to tune on a log"
            yield Mistake(f"{place}: estimator.type", problem, 'set it to "two_stage", or leave it out')
        elif self.tune.objective == "no_load" and "motor_torque" not in self.estimator.needs:
            problem = "got 'no_load', which tunes a residual, but estimator.torque.type is another"
            yield Mistake(f"{place}: tune.objective", problem, 'choose "agreement"')

    def inputs(self) -> Iterator[str]:
        """Return the paths of the log, its signal map, and the files that the map joins to it."""
        yield from super().inputs()
        recording = self.recording
        yield recording.file
        if recording.map is not None:
            yield recording.map
            folder = Path(recording.file).parent
            yield from (str(folder / name) for name in read_signal_map(Path(recording.map)).join)

    def deployed(self) -> Config:
        """Return the estimator alone: what `vsajax estimate -c` takes."""
        own = {"recording", "tune", "sweep", "seed"}
        return validate(Config, {k: v for k, v in resolved(self).items() if k not in own}, self.name)
