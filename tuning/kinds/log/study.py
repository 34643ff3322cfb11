"""A study of a log: an estimator, the recording of a robot, and the numbers to tune on it. No jax here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from tuning.files.errors import InputError, Mistake, input_error
from tuning.files.kinds import LOG_STUDY, require_kind
from tuning.files.tables import put, with_settings
from tuning.files.toml import Seed, Table, read_toml, validate
from tuning.study.base import Config, resolved
from tuning.study.parts.base import AtLeastOne, Positive
from tuning.study.parts.estimators import StiffnessEstimator
from tuning.study.paths import check_path, numeric_paths
from tuning.study.ranges import Bounds


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


class LogTune(Table):
    """What is varied, and to what end.

    Args:
        objective: "agreement": the torque signal is to be a line over the measured deflection, lagging as the
            torque does; "no_load": nothing loads the joint, the torque signal is to vanish.
        starts: of the gradient; the first is the study itself.
        screen: points tried before.
        max_steps: of a start.
        parameters: bounds by dotted path.
    """

    objective: Literal["agreement", "no_load"] = "agreement"
    starts: AtLeastOne = 4
    screen: Annotated[int, Field(ge=1)] = 64
    max_steps: AtLeastOne = 60
    parameters: Annotated[dict[str, Bounds], Field(min_length=1)]


class LogStudy(Config):
    """A configuration with the log that it is tuned on."""

    recording: LoggedRecording
    tune: LogTune
    seed: Seed = 0


def is_log_study(path: Path, settings: Sequence[str] = ()) -> bool:
    """Return whether a file is a study of a log, not of a simulated joint."""
    return "recording" in with_settings(read_toml(path), settings)


def load_log_study(path: Path, settings: Sequence[str] = ()) -> LogStudy:
    """Return the study of a log in a TOML file, with `a.b=value` settings applied before it is validated.

    Raises:
        InputError: lists every mistake with its path.
    """
    tables = with_settings(read_toml(path), settings)
    require_kind(tables, str(path), LOG_STUDY)
    study = validate(LogStudy, tables, str(path))
    numbers = numeric_paths(study)
    mistakes: list[Mistake] = []
    if not isinstance(study.estimator, StiffnessEstimator):
        problem = f"got {study.estimator.tag!r}, which has no torque signal to tune on a log"
        mistakes.append(Mistake(f"{path}: estimator.type", problem, 'set it to "two_stage", or leave it out'))
    for name, bounds in study.tune.parameters.items():
        where = f"{path}: tune.parameters.{name!r}"
        mistakes += check_path(name, where, numbers)
        if name in numbers:
            mistakes += _check_ends(study, name, bounds, where)
    if mistakes:
        raise InputError(*mistakes)
    return study


def _check_ends(study: LogStudy, name: str, bounds: Bounds, where: str) -> list[Mistake]:
    for value in bounds.ends():
        try:
            tuned_config(study, {name: value}, where)
        except InputError as error:
            return [Mistake(where, f"reaches {value:g}, which is not allowed there: {error.mistakes[0].problem}")]
    return []


def tuned_config(study: LogStudy, values: Mapping[str, float], place: str) -> Config:
    """Return the estimator alone, with numbers replaced: what `vsajax estimate -c` takes."""
    tables: dict[str, Any] = resolved(study)
    for name in ("recording", "tune", "seed"):
        tables.pop(name)
    for name, value in values.items():
        put(tables, name.split("."), value)
    return validate(Config, tables, place)


def require_untouched(folder: Path) -> None:
    """Refuse a run folder that holds a result already."""
    if (folder / "best.toml").exists():
        raise input_error(folder, "holds a finished run", "name another folder with -o")
