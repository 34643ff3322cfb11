"""The study: one TOML file that says what joint is simulated, driven, measured, estimated, scored and tuned.

Nothing here imports jax: `vsajax check` answers at once. A tuned configuration is a study too, with a
`[provenance]` table; for a real log a `Config`, without a joint, is enough.
"""

from __future__ import annotations

import copy
import difflib
import hashlib
import itertools
import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import tomlkit
from pydantic import Field, model_validator

from tuning.files.errors import InputError, Mistake, input_error
from tuning.files.kinds import CONFIG, ONLY_IN_STUDIES, STUDY, require_kind
from tuning.files.shipped import preset_path
from tuning.files.tables import merge, put, with_settings
from tuning.files.text import Line
from tuning.files.toml import UNKNOWN_KEY, Seed, Table, read_toml, validate
from tuning.study.choices import (
    Chosen,
    Setting,
    blame,
    check_choices,
    check_options,
    combinations,
    options_of,
    require_few,
    settings_of,
)
from tuning.study.parts.base import AtLeastOne, Part, Positive
from tuning.study.parts.estimators import AlgebraicObserver, AntagonisticPair, Estimator
from tuning.study.parts.joints import AntagonisticJoint, FlexibleJoint, SerialJoint
from tuning.study.parts.rig import Clock, Excitation, Scorer, Sensing
from tuning.study.parts.swings import Controller, FeedbackSensor, Impact, SwingObserver, SwingScorer, SwitchedPlant
from tuning.study.population import Population
from tuning.study.ranges import Axis, Bounds, parse_axis
from tuning.study.scores import Objective
from tuning.study.statistic import Statistic

SCHEMA_VERSION = 1

Search = Literal["sweep", "tune"]
"""A table that says what is varied and over which range."""


class Base(Table):
    """What every file says of itself."""

    schema_version: Literal[1]
    kind: str
    name: Line = "unnamed"
    provenance: dict[str, Any] = Field(default_factory=dict)


class Config(Base):
    """An estimator and how to score it: all that a recording needs."""

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
    seed: Seed = 0
    clock: Clock
    population: Population = Population()
    scenarios: Scenarios = Scenarios()
    sweep: Sweep = Sweep()
    tune: Tune = Tune()


class EstimationStudy(Study, Config):
    """A study of an estimator on a joint that is driven."""

    excitation: Excitation = Excitation()
    sensing: Sensing
    integration_tolerance: Positive = 1e-7
    substeps: AtLeastOne | None = None


class DampingStudy(Study):
    """A study of a controller that brings a link to rest by its stiffness or its motor."""

    contested: ClassVar[tuple[str, ...]] = ("controller", "observer")
    objectives: ClassVar[tuple[Objective, ...]] = ("log_energy", "settling_time")
    plant: SwitchedPlant
    impact: Impact
    controller: Controller
    sensor: FeedbackSensor | None = None
    observer: SwingObserver = SwingObserver()
    scorer: SwingScorer = SwingScorer()
    start: Positive | None = None
    substeps: AtLeastOne = 1

    @model_validator(mode="before")
    @classmethod
    def _own_objective(cls, data: dict[str, Any]) -> dict[str, Any]:
        tune = data.get("tune", {})
        return data | {"tune": {"objective": cls.objectives[0]} | tune} if isinstance(tune, dict) else data


class SerialStudy(EstimationStudy):
    """A study of a serial adjustable-stiffness joint."""

    joint: SerialJoint


class SeaStudy(EstimationStudy):
    """A study of a series-elastic actuator: one motor, one spring."""

    joint: FlexibleJoint


class AntagonisticStudy(EstimationStudy):
    """A study of an agonist-antagonist joint: two motors, two springs, an estimator a side."""

    joint: AntagonisticJoint


_STUDIES: dict[str, type[Study]] = {
    "serial": SerialStudy,
    "sea": SeaStudy,
    "antagonistic": AntagonisticStudy,
    "damping": DampingStudy,
}
_BENCH = (
    *("joint", "excitation", "sensing", "estimator", "scorer", "clock"),
    *("plant", "impact", "controller", "sensor", "observer", "start"),
)
"""The tables that describe what is simulated and judged, whose numbers can be varied."""


def load_study(path: Path, settings: Sequence[str] = (), *, unused: Collection[Search] = ()) -> Study:
    """Return the study in a TOML file, with `a.b=value` settings applied before it is validated.

    Args:
        path: the file.
        settings: changes.
        unused: searches that the caller never makes; they need not fit the rest of the study, see `parse_study`.

    Raises:
        InputError: lists every mistake with its path.
    """
    return parse_study(with_settings(read_toml(path), settings), str(path), unused=unused)


def load_estimation(path: Path, settings: Sequence[str] = ()) -> EstimationStudy:
    """Return the study of an estimator in a TOML file; as `load_study`, and any other kind is refused."""
    study = load_study(path, settings)
    if not isinstance(study, EstimationStudy):
        raise input_error(
            f"{path}: kind", f"got {study.kind!r}, which estimates nothing", "name an estimator's study"
        )
    return study


def load_config(path: Path, settings: Sequence[str] = (), *, unused: Collection[Search] = ()) -> Study | Config:
    """Return the study, or the estimator alone, in a TOML file; arguments as those of `load_study`.

    Raises:
        InputError: lists every mistake with its path.
    """
    return parse_config(with_settings(read_toml(path), settings), str(path), unused=unused)


def parse_config(data: Mapping[str, Any], place: str, *, unused: Collection[Search] = ()) -> Study | Config:
    """Return the study, or the estimator alone, in tables; arguments as those of `parse_study`."""
    require_kind(data, place, CONFIG, STUDY)
    if data.keys() & ONLY_IN_STUDIES:
        return parse_study(data, place, unused=unused)
    _check_kind(data, place)
    return validate(Config, dict(data), place)


def parse_study(data: Mapping[str, Any], place: str, *, unused: Collection[Search] = ()) -> Study:
    """Return a study from its tables.

    Args:
        data: the tables.
        place: their source, for errors.
        unused: searches that the caller never makes. Where one no longer fits the rest of the study (a range
            reaches beyond a limit that was changed), the study is returned without them instead of refused.

    Raises:
        InputError: lists every mistake with its path.
    """
    require_kind(data, place, STUDY)
    study = validate(_STUDIES[_check_kind(data, place)], _with_preset(dict(data), place), place)
    try:
        _check_together(study, place)
    except InputError:
        lean = _without(study, unused)
        if lean == study:
            raise
        _check_together(lean, place)
        return lean
    return study


def _without(study: Study, searches: Collection[Search]) -> Study:
    """Return a study that does not say what some searches vary, nor what they minimise."""
    empty = {"sweep": Sweep(), "tune": Tune(objective=study.objectives[0])}
    return study.model_copy(update={name: empty[name] for name in searches})


def _check_kind(data: Mapping[str, Any], place: str) -> str:
    kind = data.get("kind")
    if not isinstance(kind, str) or kind not in _STUDIES:
        got = "is missing" if kind is None else f"got {kind!r}"
        raise input_error(f"{place}: kind", got, f"allowed: {', '.join(_STUDIES)}")
    return kind


def resolved(config: Table) -> dict[str, Any]:
    """Return every table of a configuration, defaults written out, absent features left out."""
    return config.model_dump(exclude_none=True)


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


def numeric_paths(config: Base) -> dict[str, float]:
    """Return every number of the bench by its dotted path: what can be varied, swept and tuned."""
    found: dict[str, float] = {}

    def walk(prefix: str, value: Any) -> None:
        if isinstance(value, Part):
            for name in type(value).model_fields:
                if name not in value.static:
                    walk(f"{prefix}.{name}", getattr(value, name))
        elif isinstance(value, float):
            found[prefix] = value

    for part in _BENCH:
        walk(part, getattr(config, part, None))
    return found


def structural_paths(config: Base) -> dict[str, Setting]:
    """Return every setting of the bench that shapes a program, by its path: texts, switches and whole numbers."""
    found: dict[str, Setting] = {}

    def walk(prefix: str, value: Any) -> None:
        if isinstance(value, Part):
            for name in type(value).model_fields:
                walk(f"{prefix}.{name}", getattr(value, name))
        elif isinstance(value, str | bool | int):
            found[prefix] = value

    for part in _BENCH:
        walk(part, getattr(config, part, None))
    return found


def with_numbers(config: Base, values: Mapping[str, float], place: str) -> Study:
    """Return the study with numbers replaced, validated anew."""
    tables = resolved(config)
    for path, value in values.items():
        put(tables, path.split("."), value)
    return parse_study(tables, place)


def structures(study: Study, place: str) -> list[tuple[Chosen, Study]]:
    """Return the study of every combination of a study's choices, with the parameters and axes that exist there.

    Raises:
        InputError: lists every mistake, each once, with the option that makes it.
    """
    choices, found, mistakes = study.tune.choices, [], {}
    for chosen in combinations(choices):
        try:
            found.append((chosen, _structure(study, chosen)))
        except InputError as error:
            for mistake in error.mistakes:
                mistake = Mistake(mistake.place.removeprefix(": "), mistake.problem, mistake.fix)
                mistakes.setdefault(mistake, blame(mistake, choices, chosen, place))
    if mistakes:
        raise InputError(*dict.fromkeys(mistakes.values()))
    return found


def _structure(study: Study, chosen: Chosen) -> Study:
    tables = resolved(study)
    for path, value in settings_of(study.tune.choices, chosen).items():
        try:
            put(tables, path.split("."), copy.deepcopy(value))
        except TypeError:
            raise input_error(path, "leads through a value that is not a table") from None
    tune, sweep = tables["tune"] | {"choices": {}}, tables["sweep"]
    numbers = numeric_paths(parse_study(tables | {"tune": tune | {"parameters": {}}, "sweep": {}}, ""))
    options = set(chosen.values())
    tune["parameters"] = {
        path: {key: value for key, value in bounds.items() if key != "only"}
        for path, bounds in tune["parameters"].items()
        if path in numbers and ("only" not in bounds or options & set(bounds["only"]))
    }
    sweep["grid"] = {path: axis for path, axis in sweep["grid"].items() if path in numbers}
    return parse_study(tables | {"tune": tune, "sweep": sweep}, "")


def with_grid(study: Study, grids: Sequence[str], scenarios: int | None) -> Study:
    """Return the study with its sweep replaced by command-line axes, and its number of scenarios.

    Raises:
        InputError: an axis cannot be read, leads nowhere, or reaches values that are not allowed.
    """
    axes = dict(parse_axis(text) for text in grids) or study.sweep.grid
    sweep = Sweep(scenarios=scenarios or study.sweep.scenarios, grid=axes)
    changed = study.model_copy(update={"sweep": sweep})
    _check_together(changed, "--grid")
    return changed


def _check_together(study: Study, place: str) -> None:
    """Check what no single table can: signals that are needed but not measured, paths, ranges."""
    mistakes = _check_estimation(study, place) if isinstance(study, EstimationStudy) else []
    if study.tune.objective not in study.objectives:
        problem = f"got {study.tune.objective!r}, which a study of kind {study.kind!r} does not score"
        fix = f"allowed: {', '.join(study.objectives)}"
        mistakes.append(Mistake(f"{place}: tune.objective", problem, fix))
    if isinstance(study, DampingStudy) and study.clock.jitter_std is not None:
        fix = "remove it: a controller's clock is regular"
        mistakes.append(Mistake(f"{place}: clock.jitter_std", f"got {study.clock.jitter_std}", fix))
    numbers = numeric_paths(study)
    # Where structures are chosen, a parameter need only exist in one of them, which is checked there.
    tuned = {} if study.tune.choices else study.tune.parameters
    for path, bounds in tuned.items():
        where = f"{place}: tune.parameters.{path!r}"
        mistakes += check_path(path, where, numbers)
        if path in numbers:
            mistakes += _check_values(study, path, bounds, where)
    mistakes += _check_grid(study, f"{place}: sweep.grid", numbers)
    if study.tune.choices and not mistakes:
        mistakes += _check_structures(study, place)
    mistakes += _check_only(study, place)
    mistakes += _check_population(study, place, numbers)
    if mistakes:
        raise InputError(*mistakes)


def _check_grid(study: Study, place: str, numbers: Mapping[str, float]) -> list[Mistake]:
    """Check that axes lead to numbers within their limits, or to settings that can be combined."""
    mistakes, settings = [], structural_paths(study)
    for path, axis in study.sweep.grid.items():
        where = f"{place}.{path!r}"
        mistakes += check_path(path, where, {**settings, **numbers})
        if path in numbers and axis.options is None:
            mistakes += _check_values(study, path, axis, where)
        elif path in numbers and axis.options is not None:
            mistakes.append(Mistake(where, f"got {axis.options[0]!r}; needs numbers", "e.g. 1,2,5"))
        elif path in settings:
            mistakes += check_options(axis, settings[path], where)
    if mistakes or study.sweep.grid.keys() <= numbers.keys():
        return mistakes
    try:
        grid_structures(study, place)
    except InputError as error:
        return list(error.mistakes)
    return []


def grid_structures(study: Study, place: str) -> list[tuple[dict[str, Setting], Study]]:
    """Return the study of every combination of the settings that its grid varies; itself where it varies none.

    Of its axes and parameters each study keeps those that lead to numbers of its own.

    Raises:
        InputError: a combination is no valid study, or there are more than can be compiled.
    """
    settings = structural_paths(study)
    axes = {path: options_of(axis, settings[path]) for path, axis in study.sweep.grid.items() if path in settings}
    if not axes:
        return [({}, study)]
    require_few(axes, place)
    found, mistakes = [], {}
    for chosen in (dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())):
        try:
            found.append((chosen, _regrid(study, chosen)))
        except InputError as error:
            said = ", ".join(f"{path} = {value}" for path, value in chosen.items())
            wider = "name a study whose table has more keys, or use tune.choices, whose options are tables"
            for m in error.mistakes:
                where, fix = m.place.removeprefix(": "), wider if m.problem == "is missing" else m.fix
                mistakes.setdefault((where, m.problem), Mistake(f"{place} ({said}): {where}", m.problem, fix))
    if mistakes:
        raise InputError(*mistakes.values())
    return found


def _regrid(study: Study, chosen: Mapping[str, Setting]) -> Study:
    """Return a study with settings replaced, without the keys, axes and parameters that then have no place."""
    tables = resolved(study)
    for path, value in chosen.items():
        put(tables, path.split("."), value)
    bare = {"tune": {**tables["tune"], "parameters": {}, "choices": {}}, "sweep": {}}
    try:
        numbers = numeric_paths(parse_study(tables | bare, ""))
    except InputError as error:
        if not _drop_unknown(tables, error, chosen):
            raise
        numbers = numeric_paths(parse_study(tables | bare, ""))
    for table, key in (("tune", "parameters"), ("sweep", "grid")):
        tables[table][key] = {path: axis for path, axis in tables[table][key].items() if path in numbers}
    tables["tune"]["choices"] = {}
    return parse_study(tables, "")


def _drop_unknown(tables: dict[str, Any], error: InputError, chosen: Mapping[str, Setting]) -> bool:
    """Remove keys that a chosen type has no use for, and return whether there were any."""
    changed = [path.rpartition(".")[0] for path in chosen if path.endswith(".type")]
    dropped = False
    for mistake in error.mistakes:
        path = mistake.place.removeprefix(": ")
        parent, _, key = path.rpartition(".")
        if mistake.problem == UNKNOWN_KEY and parent in changed:
            inner = tables
            for name in parent.split("."):
                inner = inner[name]
            del inner[key]
            dropped = True
    return dropped


def _check_only(study: Study, place: str) -> list[Mistake]:
    """Check that parameters which exist in some options alone name options."""
    options = [option for choice in study.tune.choices.values() for option in choice]
    return [
        Mistake(
            f"{place}: tune.parameters.{path!r}.only",
            f"names {option!r}, which is no option of tune.choices",
            f"allowed: {', '.join(options)}" if options else "remove it: there are no choices",
        )
        for path, bounds in study.tune.parameters.items()
        for option in bounds.only or []
        if option not in options
    ]


def _check_estimation(study: EstimationStudy, place: str) -> list[Mistake]:
    """Check an estimator against its joint, its sensors and its clock."""
    mistakes = [
        Mistake(
            f"{place}: sensing.{name}",
            "is missing, but the estimator needs this signal",
            f"add a [sensing.{name}] table, or choose another torque, deflection or basis",
        )
        for name in sorted(study.estimator.needs)
        if getattr(study.sensing, name) is None
    ]
    mistakes += check_pairing(study, place)
    mistakes += _check_windows(study, place)
    if study.tune.objective == "msrep_settled" and study.scorer.warm_up >= study.clock.duration:
        problem = f"got {study.scorer.warm_up} s; no sample of {study.clock.duration} s is left for tune.objective"
        mistakes.append(Mistake(f"{place}: scorer.warm_up", problem, "record for longer, or warm up for less"))
    return mistakes


def _check_structures(study: Study, place: str) -> list[Mistake]:
    """Check every combination of the choices, and that each parameter exists in one of them."""
    mistakes = check_choices(study.tune.choices, place)
    if mistakes:
        return mistakes
    try:
        found = [numeric_paths(structure) for _, structure in structures(study, place)]
    except InputError as error:
        return list(error.mistakes)
    everywhere = {path: value for numbers in found for path, value in numbers.items()}
    paths = study.tune.parameters
    return [m for p in paths for m in check_path(p, f"{place}: tune.parameters.{p!r}", everywhere)]


def _check_population(study: Study, place: str, numbers: Mapping[str, float]) -> list[Mistake]:
    """Check that what varies leads to numbers, stays within their limits, and is not chosen elsewhere too."""
    mistakes = []
    for path in study.population.paths:
        where = f"{place}: population.{path!r}"
        mistakes += check_path(path, where, numbers)
        for table, chosen in (("sweep.grid", study.sweep.grid), ("tune.parameters", study.tune.parameters)):
            if path in chosen:
                fix = "remove one of them: a scenario's number cannot be chosen and drawn"
                mistakes.append(Mistake(where, f"is in {table} too", fix))
    if mistakes:
        return mistakes
    for path, value in study.population.ends(numbers):
        where = f"{place}: population.{path!r}"
        fix = "narrow the distribution, or cut it off with low and high"
        mistakes += [Mistake(where, m.problem, m.fix or fix) for m in _check_value(study, path, value, where)]
    return mistakes


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
    got = config.estimator.type
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


def check_path(path: str, where: str, numbers: Mapping[str, object]) -> list[Mistake]:
    """Return what is wrong with a dotted path that should lead to a number of the bench."""
    if path in numbers:
        return []
    near = difflib.get_close_matches(path, numbers, 3, 0.5)
    fix = f"did you mean {' or '.join(near)}?" if near else "`vsajax check STUDY` lists every number"
    return [Mistake(where, "leads to no number of the study", fix)]


def _check_values(study: Study, path: str, axis: Axis | Bounds, where: str) -> list[Mistake]:
    """Check the ends of a range against the limits of the number that it replaces."""
    return [mistake for value in axis.ends() for mistake in _check_value(study, path, value, where)][:1]


def _check_value(study: Study, path: str, value: float, where: str) -> list[Mistake]:
    """Check one value that a number will take."""
    tables = resolved(study) | {"sweep": {}, "tune": {}, "population": {}}
    put(tables, path.split("."), float(value))
    try:
        validate(type(study), tables, where)
    except InputError as error:
        problem = error.mistakes[0].problem
        return [Mistake(where, f"reaches {value:g}, which is not allowed there: {problem}")]
    return []


def _with_preset(data: dict[str, Any], place: str) -> dict[str, Any]:
    """Replace `joint.preset` by the preset's tables, which the joint's other keys override."""
    joint = data.get("joint")
    if not isinstance(joint, dict) or "preset" not in joint:
        return data
    own = {key: value for key, value in joint.items() if key != "preset"}
    return data | {"joint": merge(read_toml(preset_path(joint["preset"], f"{place}: joint.preset")), own)}
