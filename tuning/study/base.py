"""What every study has: the tables that all kinds share, and what identifies a study."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar, Literal, Self

import tomlkit
from pydantic import Field, ModelWrapValidatorHandler, model_validator

from tuning.files.errors import InputError, Mistake
from tuning.files.shipped import choose
from tuning.files.tables import merge
from tuning.files.text import Line
from tuning.files.toml import SchemaVersion, Seed, Table, read_toml, validate
from tuning.study.foreign import PLUGINS, absent, foreign_in, require_recorded
from tuning.study.parts.base import AtLeastOne
from tuning.study.parts.estimators import Estimator
from tuning.study.parts.rig import Clock, Scorer
from tuning.study.population import Population
from tuning.study.ranges import EVERYTHING, Axis, Bounds, Reach
from tuning.study.scores import Objective
from tuning.study.statistic import Statistic

Search = Literal["sweep", "tune"]
"""A table that says what is varied and over which range."""


class Base(Table):
    """What every file says of itself.

    `varied` are the tables whose numbers can be varied; `presets` those that can be a shipped file, by its folder.
    """

    varied: ClassVar[tuple[str, ...]] = ()
    presets: ClassVar[Mapping[str, str]] = {}
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


class Config(Base):
    """An estimator and how to score it: all that a recording needs."""

    varied: ClassVar[tuple[str, ...]] = ("estimator", "scorer")
    estimator: Estimator
    scorer: Scorer = Scorer()


class Scenarios(Table):
    """How many noise draws there are to tune on, and how many others to judge by.

    They are drawn from different streams of the seed: no draw is in both.
    """

    train: AtLeastOne = 32
    held_out: AtLeastOne = 256


class Sweep(Table):
    """The grid of `vsajax sweep`; `scenarios` noise draws are run at each of its points."""

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
    """Everything that the lab does with one kind of bench.

    `contested` are the tables of what is tuned and compared; `objectives` the scores that may be minimised.
    """

    contested: ClassVar[tuple[str, ...]] = ("estimator",)
    objectives: ClassVar[tuple[Objective, ...]] = ("msrep", "msrep_settled")

    def no_gradient(self, place: str, method: str) -> Mistake | None:
        """Return why the objective has no gradient, which `method` needs; `None` where it has one."""
        del place, method
        return None

    def reach(self, path: str) -> Reach:
        """Return what the number at a path changes at most."""
        del path
        return EVERYTHING

    seed: Seed = 0
    clock: Clock
    population: Population = Population()
    scenarios: Scenarios = Scenarios()
    sweep: Sweep = Sweep()
    tune: Tune = Tune()


def resolved(config: Table) -> dict[str, Any]:
    """Return every table of a configuration, defaults written out, absent features left out.

    One that uses something foreign has a table `plugins` of names and versions.
    """
    foreign = foreign_in(config)
    return config.model_dump(exclude_none=True) | ({PLUGINS: foreign} if foreign else {})


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
