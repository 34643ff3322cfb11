"""What every study has: the tables that all kinds share, and what identifies a study."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import tomlkit
from pydantic import Field, ModelWrapValidatorHandler, model_validator

from tuning.files.errors import InputError, Mistake
from tuning.files.shipped import choose
from tuning.files.tables import merge
from tuning.files.text import Line
from tuning.files.toml import SchemaVersion, Seed, Table, read_toml, validate
from tuning.study.foreign import PLUGINS, absent, foreign_in, require_recorded
from tuning.study.parts.base import AtLeastOne, parts_in
from tuning.study.parts.estimators import Estimator
from tuning.study.parts.rig import Clock, Scorer
from tuning.study.population import Population
from tuning.study.ranges import EVERYTHING, Axis, Bounds, Reach
from tuning.study.scores import Objective
from tuning.study.statistic import Statistic

ROBOTS = 4096
"""Scenarios of a Monte Carlo run for which no number is given."""
FOLDER = "folder"
"""Key of `provenance`: where relative paths of files that a study names start."""
Search = Literal["sweep", "tune"]
"""A table that says what is varied and over which range."""


class Base(Table):
    """What every file says of itself.

    `varied` are the tables whose numbers can be varied; `presets` those that can be a shipped file, by its folder;
    `later` those that came when there were files of this kind already: with their defaults they are left out of
    what is written, so that such a file keeps its hash.
    """

    varied: ClassVar[tuple[str, ...]] = ()
    presets: ClassVar[Mapping[str, str]] = {}
    later: ClassVar[frozenset[str]] = frozenset()
    schema_version: SchemaVersion
    kind: str
    name: Line = "unnamed"
    provenance: dict[str, Any] = Field(default_factory=dict)

    @model_validator(mode="wrap")
    @classmethod
    def _made_with(cls, data: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        """Refuse a file that was made with another version of a plug-in than is here."""
        recorded = data.get(PLUGINS) if isinstance(data, dict) else None
        if recorded is None:
            return handler(data)
        study = handler({key: value for key, value in data.items() if key != PLUGINS})
        require_recorded(recorded, foreign_in(study))
        return study

    @classmethod
    def parsed(cls, tables: Mapping[str, Any], place: str) -> Self:
        """Return it from its tables, with the file of a preset in its place; a table's own keys override it.

        Every table is checked by itself; what no single one can see is told by `mistakes`.

        Raises:
            InputError: lists every mistake with its path.
        """
        data = dict(tables)
        for name, folder in cls.presets.items():
            table = data.get(name)
            if isinstance(table, dict) and "preset" in table:
                own = {key: value for key, value in table.items() if key != "preset"}
                preset = read_toml(choose(folder, table["preset"], f"{place}: {name}.preset"))
                data[name] = merge(preset, own)
        try:
            return validate(cls, data, place)
        except InputError as error:
            # Where it names what is not here, the package to install is told first.
            raise InputError(*absent(data.get(PLUGINS), f"{place}: {PLUGINS}"), *error.mistakes) from None

    def mistakes(self, place: str) -> Iterator[Mistake]:
        """Return what is wrong though every table is right by itself; searches apart, see `structures`."""
        del place
        yield from ()

    @property
    def folder(self) -> Path:
        """Where relative paths of files that it names start."""
        return Path()

    def notes(self) -> list[str]:
        """Return what is worth knowing of it though it is right, in sentences."""
        return []

    def inputs(self) -> Iterator[str]:
        """Return the paths of the files that it names, and whose contents determine results."""
        for part in parts_in(self):
            yield from (path for name in part.files if (path := getattr(part, name)) is not None)


class Config(Base):
    """An estimator and how to score it: all that a recording needs."""

    varied: ClassVar[tuple[str, ...]] = ("estimator", "scorer")
    estimator: Estimator
    scorer: Scorer = Scorer()


class Scenarios(Table):
    """How many scenarios there are to tune on, and how many others to judge by.

    They are drawn from different streams of the seed: none is in both.
    """

    train: AtLeastOne = 32
    held_out: AtLeastOne = 256


class Sweep(Table):
    """The grid of `vsajax sweep`; so many `scenarios` are run at each of its points."""

    scenarios: AtLeastOne = 16
    grid: dict[str, Axis] = Field(default_factory=dict)


class Tune(Table):
    """What `vsajax tune` varies, and how it looks for the best.

    What is minimised is a statistic over the training scenarios, by default the mean, of the printed index
    `msrep`, which the first milliseconds decide, or of `msrep_settled`, from the scorer's warm-up time on.
    What is no number is chosen: `choices` has a table of settings by dotted path for every option of a choice.
    """

    objective: Objective = "msrep"
    statistic: Statistic = Statistic()
    starts: AtLeastOne = 4
    screen: Annotated[int, Field(ge=0)] = 64
    max_steps: AtLeastOne = 60
    parameters: dict[str, Bounds] = Field(default_factory=dict)
    choices: dict[str, dict[str, dict[str, Any]]] = Field(default_factory=dict)


class Study(Base):
    """Everything that the lab does with what it can score.

    `contested` are the tables of what is tuned and compared; `objectives` the scores that may be minimised, the
    first of them where nothing else is said.
    """

    contested: ClassVar[tuple[str, ...]] = ("estimator",)
    objectives: ClassVar[tuple[Objective, ...]] = ("msrep", "msrep_settled")
    seed: Seed = 0
    population: Population = Population()
    scenarios: Scenarios = Scenarios()
    sweep: Sweep = Sweep()
    tune: Tune = Tune()

    @model_validator(mode="before")
    @classmethod
    def _own_objective(cls, data: dict[str, Any]) -> dict[str, Any]:
        tune = data.get("tune", {})
        return data | {"tune": {"objective": cls.objectives[0]} | tune} if isinstance(tune, dict) else data

    def deployed(self) -> Base:
        """Return what is of use on a robot: what `best.toml` holds of a study that was tuned."""
        return self

    def no_gradient(self, place: str, method: str) -> Mistake | None:
        """Return why the objective has no gradient, which `method` needs; `None` where it has one."""
        del place, method
        return None

    def reach(self, path: str) -> Reach:
        """Return what the number at a path changes at most."""
        del path
        return EVERYTHING

    def no_scenarios(self) -> str:
        """Return why no scenarios are drawn; nothing where they are."""
        return ""

    def robots(self, asked: int | None) -> int:
        """Return how many scenarios a Monte Carlo run has.

        Args:
            asked: how many were asked for, if any: of each group, where a kind draws its scenarios in groups.
        """
        return asked or ROBOTS


class _Clocked(Base):
    """The clock, where it stands in a file: after the seed, and ahead of all else that `Study` has."""

    seed: Seed = 0
    clock: Clock


class Timed(Study, _Clocked):
    """A study of what runs over time, sampled by a clock."""

    def has_own_motions(self) -> bool:
        """Return whether scenarios differ in how the joint moves, not in noise alone."""
        paths = [*self.population.paths, *self.sweep.grid]
        return self.clock.jitter_std is not None or any(Reach.MOTION in self.reach(path) for path in paths)

    def tones(self) -> int:
        """Return how many sines drive it, each computed at every sample."""
        return 0

    def substeps_set(self) -> int | None:
        """Return how many integration steps a sample the study sets; `None` where the lab chooses, or none are."""
        return None

    def longest_delay(self) -> int:
        """Return how many samples a reading may be late in a loop; each is a part of the program."""
        return 0


def resolved(config: Table) -> dict[str, Any]:
    """Return every table of a configuration, defaults written out, absent features left out.

    Left out too are tables that came `later` and say nothing. What uses something foreign has a table `plugins`
    of names and versions.
    """
    foreign = foreign_in(config)
    own = config.model_dump(exclude_none=True, exclude=_still_default(config))
    return own | ({PLUGINS: foreign} if foreign else {})


def every_table(study: Study) -> dict[str, Any]:
    """Return what `resolved` does, and the tables that came later, whatever they say."""
    return study.model_dump(exclude_none=True)


def _still_default(config: Table) -> dict[str, Any]:
    """Return the keys that came later and say nothing, as pydantic leaves them out."""
    found: dict[str, Any] = {}
    later: frozenset[str] = getattr(config, "later", frozenset())
    for name, field in type(config).model_fields.items():
        value = getattr(config, name)
        if name in later and value == field.get_default(call_default_factory=True, validated_data={}):
            found[name] = True
        elif isinstance(value, Table) and (inner := _still_default(value)):
            found[name] = inner
    return found


def descended(study: Base, provenance: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tables of a study that a command made, with what it follows from; where its files lie stays."""
    kept = {key: value for key, value in study.provenance.items() if key == FOLDER}
    return resolved(study) | {"provenance": kept | dict(provenance)}


def study_hash(config: Table) -> str:
    """Return a hash of all that determines a study's results; its name and provenance do not."""
    return hash_resolved(resolved(config))


def hash_resolved(resolved_tables: Mapping[str, Any]) -> str:
    """Return the hash of a study from its resolved tables, as `study_hash` does."""
    tables = {k: v for k, v in resolved_tables.items() if k not in {"name", "provenance"}}
    return hashlib.sha256(json.dumps(tables, sort_keys=True).encode()).hexdigest()[:16]


def to_toml(tables: Mapping[str, Any]) -> str:
    """Return tables as TOML text."""
    return tomlkit.dumps(tables)
