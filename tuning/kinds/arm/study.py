"""The study of an arm: its kinematics, its joints, what the hand should be like; nothing imports jax."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from tuning.files.errors import InputError, Mistake
from tuning.files.kinds import ARM_STUDY
from tuning.files.text import Line
from tuning.files.toml import Table
from tuning.kinds.arm.chain import Chain
from tuning.kinds.arm.kinematics import chain_of
from tuning.kinds.arm.names import listed
from tuning.kinds.arm.tables import FARTHEST_DEG, Arm, Pair, Vector3
from tuning.study.base import FOLDER, Study, Tune
from tuning.study.kinds import lacking
from tuning.study.loading import load
from tuning.study.parts.base import AtLeastOne, NonNegative, Part, Positive
from tuning.study.scores import Objective

Numbers = Annotated[list[Positive], Field(min_length=1)]

_ROUNDING = 1e-9
"""Of degrees turned into radians."""


class JointStiffness(Part):
    """What the joints' mechanisms can be set to [N·m/rad]; one number for all, or one a joint."""

    lower: Positive | Numbers
    upper: Positive | Numbers


class Task(Table):
    """What the hand should be like, and the force that pulls at it [N]."""

    space: Literal["position", "pose"] = "position"
    stiffness: list[float] | list[list[float]]
    length: Positive = 0.3
    load: Vector3 = Field(default_factory=lambda: [0.0, 0.0, 0.0])

    @property
    def size(self) -> int:
        """Rows of the stiffness matrix."""
        return 3 if self.space == "position" else 6

    def matrix(self) -> list[list[float]]:
        """Return K_d, row by row."""
        rows = self.stiffness
        if all(isinstance(row, float) for row in rows):
            return [[float(v) if i == j else 0.0 for j in range(len(rows))] for i, v in enumerate(rows)]  # pyright: ignore
        return [list(map(float, row)) for row in rows]  # pyright: ignore


class Controller(Part):
    """The active stage."""

    max_stiffness: Positive = 4545.0
    scaling: Literal["none", "printed", "exact"] = "exact"
    clip: bool = True


class Workspace(Table):
    """How many poses are drawn from the joints' ranges, and the plane of the map."""

    poses: AtLeastOne = 20000
    plane: Literal["xy", "xz", "yz"] = "xy"
    cells: AtLeastOne = 48


class Poses(Table):
    """The search for better poses of the same hand position.

    Targets and starts are drawn from `drawn_deg`, a pair a joint, by default from the joints' whole ranges.
    """

    targets: AtLeastOne = 128
    starts: AtLeastOne = 6
    steps: AtLeastOne = 60
    drawn_deg: list[Pair] = Field(default_factory=list)

    @model_validator(mode="after")
    def _ordered(self) -> Poses:
        for pair in self.drawn_deg:
            if pair[0] > pair[1]:
                raise ValueError(f"drawn_deg must be pairs of low, then high; got {pair}")
        return self


class Accuracy(Table):
    """Levels of the error in the joints' stiffness, and how many arms are drawn at each."""

    msrep: list[NonNegative] = Field(default_factory=lambda: [1e-3, 1e-2, 1e-1, 1.0, 10.0])
    draws: AtLeastOne = 2000
    run: Line | None = None


class ArmStudy(Study):
    """Everything that the lab does with an arm.

    A scenario is a pose of the joints' ranges and an error of each joint's stiffness, at one of the levels of
    `accuracy`: scenario i is draw i // levels at level i % levels, so that all levels see the same draws.
    """

    varied: ClassVar[tuple[str, ...]] = ("joints", "controller")
    presets: ClassVar[Mapping[str, str]] = {"arm": "arms"}
    later: ClassVar[frozenset[str]] = frozenset({"population", "scenarios", "sweep", "tune"})
    contested: ClassVar[tuple[str, ...]] = ("joints", "controller")
    objectives: ClassVar[tuple[Objective, ...]] = ("stiffness_error", "compliance_error", "stiffness_change")
    kind: Literal["arm"]  # pyright: ignore[reportIncompatibleVariableOverride] - one name of those that there are
    tune: Tune = Tune(objective="stiffness_error")
    arm: Arm
    joints: JointStiffness
    task: Task
    controller: Controller = Controller()
    workspace: Workspace = Workspace()
    poses: Poses = Poses()
    accuracy: Accuracy = Accuracy()

    @classmethod
    def parsed(cls, tables: Mapping[str, Any], place: str) -> Self:
        """Return it from its tables; where the files that it names by relative paths lie is kept with it.

        They lie beside the study's file. A study that a command has written keeps where those of the study that it
        follows from lie, unless they were put beside it.
        """
        study = super().parsed(tables, place)
        named = [name for name in study.inputs() if not Path(name).is_absolute()]
        here = Path(place).parent.absolute()
        is_beside = Path(place).is_file() and all((here / name).is_file() for name in named)
        if not named or (FOLDER in study.provenance and not is_beside):
            return study
        return study.model_copy(update={"provenance": study.provenance | {FOLDER: str(here)}})

    @property
    def folder(self) -> Path:
        """Where relative paths of files that it names start."""
        return Path(str(self.provenance.get(FOLDER, "")))

    def inputs(self) -> Iterator[str]:
        """Return the paths of the files that it names, and whose contents determine results."""
        if self.arm.urdf is not None:
            yield self.arm.urdf
        if self.accuracy.run is not None:
            yield f"{self.accuracy.run}/results.parquet"

    @property
    def chain(self) -> Chain:
        """The joints of its arm; a URDF is read."""
        return chain_of(self.arm, "study", self.folder)

    @property
    def levels(self) -> list[float]:
        """The levels of MSREP at which scenarios are drawn [%]; NaN stands for that of another run's robots."""
        return [*self.accuracy.msrep, *([] if self.accuracy.run is None else [math.nan])]

    def robots(self, asked: int | None) -> int:
        """Return how many scenarios a Monte Carlo run has: so many draws, or the study's, at each level."""
        return (asked or self.accuracy.draws) * len(self.levels)

    def no_gradient(self, place: str, method: str) -> Mistake | None:
        """Return why the scores have no gradient to go by."""
        del method
        why = "its scores are flat where a design is exact, and kinked where a joint meets its bound"
        return lacking(place, self, f"gradient ({why})", f"vsajax tune {place} -o RUN --method cmaes")

    def notes(self) -> list[str]:
        """Return a sentence for each joint that the study's pose puts outside of its range."""
        return outside_of(self, self.chain)

    def mistakes(self, place: str) -> Iterator[Mistake]:
        """Return what is wrong of the task, and of numbers that there must be one of a joint; a URDF is read."""
        yield from check_task(self.task, place)
        try:
            yield from check_joints(self, chain_of(self.arm, place, self.folder), place)
        except InputError as error:
            yield from error.mistakes
        if not self.levels:
            fix = "give at least one level of MSREP, e.g. [0.1]"
            yield Mistake(f"{place}: accuracy.msrep", "is empty, and there is no accuracy.run", fix)


def load_arm_study(path: Path, settings: Sequence[str] = ()) -> ArmStudy:
    """Return the study in a TOML file, with `a.b=value` settings applied before it is validated.

    Raises:
        InputError: lists every mistake with its path.
    """
    study = load(path, settings, ARM_STUDY)
    assert isinstance(study, ArmStudy)
    return study


def check_task(task: Task, place: str) -> list[Mistake]:
    """Return what is wrong with the desired stiffness: it must be a symmetric positive definite matrix."""
    where, size, rows = f"{place}: task.stiffness", task.size, task.matrix()
    if len(rows) != size or any(len(row) != size for row in rows):
        fix = f"give the {size} numbers of its diagonal, or {size} rows of {size}"
        return [Mistake(where, f"got {len(rows)} rows; space {task.space!r} needs {size}", fix)]
    largest = max(abs(v) for row in rows for v in row)
    for i in range(size):
        for j in range(i):
            if abs(rows[i][j] - rows[j][i]) > 1e-9 * largest:
                problem = f"is not symmetric: row {i + 1} has {rows[i][j]:g}, row {j + 1} has {rows[j][i]:g}"
                return [Mistake(where, problem, "make the two equal")]
    if not _is_definite(rows):
        problem = "is not positive definite"
        return [Mistake(where, problem, "every direction needs a stiffness above 0, e.g. a positive diagonal")]
    return []


def _is_definite(rows: list[list[float]]) -> bool:
    factor: list[list[float]] = []
    for i, row in enumerate(rows):
        own: list[float] = []
        for j in range(i):
            own.append((row[j] - sum(a * b for a, b in zip(own, factor[j], strict=False))) / factor[j][j])
        pivot = row[i] - sum(a * a for a in own)
        if pivot <= 1e-12 * abs(row[i]):
            return False
        factor.append([*own, math.sqrt(pivot)])
    return True


def check_joints(study: ArmStudy, chain: Chain, place: str) -> list[Mistake]:
    """Return what is wrong with numbers that there must be one of a joint, in the order of the chain."""
    mistakes = []
    count, named = chain.joints, _named(chain)
    bounds: dict[str, list[float]] = {}
    for name in ("lower", "upper"):
        given = getattr(study.joints, name)
        bounds[name] = given if isinstance(given, list) else [given] * count
        if len(bounds[name]) != count:
            problem = f"got {len(bounds[name])} numbers; the arm has {count} joints{named}"
            mistakes.append(Mistake(f"{place}: joints.{name}", problem, "give one number, or one a joint"))
    if not mistakes:
        for joint, low, high in zip(chain.titles, bounds["lower"], bounds["upper"], strict=True):
            if low > high:
                problem = f"{joint} has lower {low:g} above upper {high:g}"
                mistakes.append(Mistake(f"{place}: joints", problem, "exchange them"))
    for name, given, what in (
        ("arm.pose_deg", study.arm.pose_deg, "angle"),
        ("poses.drawn_deg", study.poses.drawn_deg, "pair"),
    ):
        if given and len(given) != count:
            problem = f"got {len(given)} {what}s; the arm has {count} joints{named}"
            mistakes.append(Mistake(f"{place}: {name}", problem, f"give one {what} a joint"))
    for joint, angle in zip(chain.titles, study.arm.pose_deg, strict=False):
        if abs(angle) > FARTHEST_DEG:
            problem = f"{joint} has {angle:g}; allowed: within ±{FARTHEST_DEG:g}"
            mistakes.append(Mistake(f"{place}: arm.pose_deg", problem, "give angles in degrees"))
    if not mistakes:
        mistakes += _check_drawn(study, chain, place)
    return mistakes


def _named(chain: Chain) -> str:
    return f": {listed(chain.names)}" if chain.is_named else ""


def _check_drawn(study: ArmStudy, chain: Chain, place: str) -> list[Mistake]:
    mistakes = []
    for joint, own, whole in zip(chain.titles, study.poses.drawn_deg, chain.ranges, strict=False):
        least, most = (math.degrees(angle) for angle in whole)
        if own[0] < least - _ROUNDING or own[1] > most + _ROUNDING:
            problem = f"{joint} has {own[0]:g} to {own[1]:g}; its range is {least:g} to {most:g}"
            mistakes.append(Mistake(f"{place}: poses.drawn_deg", problem, "stay within the range"))
    return mistakes


def outside_of(study: ArmStudy, chain: Chain) -> list[str]:
    """Return a sentence for each joint that the study's pose puts outside of its range."""
    said = []
    for i, angle in enumerate(study.arm.pose_deg):
        joint, (least, most) = chain.titles[i], map(math.degrees, chain.ranges[i])
        if not chain.endless[i] and not least - _ROUNDING <= angle <= most + _ROUNDING:
            said.append(
                f"arm.pose_deg puts {joint} at {angle:g}, outside of its range of {least:g} to {most:g} deg"
            )
    return said
