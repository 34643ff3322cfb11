"""What a study varies, checked in every structure that its choices and axes make."""

from __future__ import annotations

import copy
import itertools
from collections.abc import Mapping, Sequence
from typing import Any

from tuning.files.errors import InputError, Mistake, input_error
from tuning.files.tables import put
from tuning.files.toml import UNKNOWN_KEY, validate
from tuning.study.base import Study, every_table, resolved
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
from tuning.study.paths import check_path, numeric_paths, structural_paths
from tuning.study.ranges import Axis, Bounds, parse_axis


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
    tables = every_table(study)
    for path, value in settings_of(study.tune.choices, chosen).items():
        try:
            put(tables, path.split("."), copy.deepcopy(value))
        except TypeError:
            raise input_error(path, "leads through a value that is not a table") from None
    tune, sweep = tables["tune"] | {"choices": {}}, tables["sweep"]
    numbers = numeric_paths(_anew(study, tables | {"tune": tune | {"parameters": {}}, "sweep": {}}))
    options = set(chosen.values())
    tune["parameters"] = {
        path: {key: value for key, value in bounds.items() if key != "only"}
        for path, bounds in tune["parameters"].items()
        if path in numbers and ("only" not in bounds or options & set(bounds["only"]))
    }
    sweep["grid"] = {path: axis for path, axis in sweep["grid"].items() if path in numbers}
    return _anew(study, tables | {"tune": tune, "sweep": sweep})


def with_grid(study: Study, grids: Sequence[str], scenarios: int | None) -> Study:
    """Return the study with its sweep replaced by command-line axes, and its number of scenarios.

    Raises:
        InputError: an axis cannot be read, leads nowhere, or reaches values that are not allowed.
    """
    axes = dict(parse_axis(text) for text in grids) or study.sweep.grid
    asked = {"scenarios": scenarios or study.sweep.scenarios, "grid": axes}
    sweep = validate(type(study.sweep), asked, "--scenarios" if scenarios else "--grid")
    changed = study.model_copy(update={"sweep": sweep})
    check_whole(changed, "--grid")
    return changed


def _anew(study: Study, tables: Mapping[str, Any]) -> Study:
    """Return another study of the same kind, checked as a whole."""
    other = type(study).parsed(tables, "")
    check_whole(other, "")
    return other


def check_whole(study: Study, place: str) -> None:
    """Check what no single table can: signals that are needed but not measured, paths, ranges."""
    mistakes = list(study.mistakes(place))
    if study.tune.objective not in study.objectives:
        problem = f"got {study.tune.objective!r}, which a study of kind {study.kind!r} does not score"
        fix = f"allowed: {', '.join(study.objectives)}"
        mistakes.append(Mistake(f"{place}: tune.objective", problem, fix))
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
    tables = every_table(study)
    for path, value in chosen.items():
        put(tables, path.split("."), value)
    bare = {"tune": {**tables["tune"], "parameters": {}, "choices": {}}, "sweep": {}}
    try:
        numbers = numeric_paths(_anew(study, tables | bare))
    except InputError as error:
        if not _drop_unknown(tables, error, chosen):
            raise
        numbers = numeric_paths(_anew(study, tables | bare))
    for table, key in (("tune", "parameters"), ("sweep", "grid")):
        tables[table][key] = {path: axis for path, axis in tables[table][key].items() if path in numbers}
    tables["tune"]["choices"] = {}
    return _anew(study, tables)


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


def _check_structures(study: Study, place: str) -> list[Mistake]:
    """Check every combination of the choices, and that each parameter exists in one of them."""
    mistakes = check_choices(study.tune.choices, study.varied, place)
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


def _check_values(study: Study, path: str, axis: Axis | Bounds, where: str) -> list[Mistake]:
    """Check the ends of a range against the limits of the number that it replaces."""
    return [mistake for value in axis.ends() for mistake in _check_value(study, path, value, where)][:1]


def _check_value(study: Study, path: str, value: float, where: str) -> list[Mistake]:
    """Check one value that a number will take."""
    searches = {"sweep", "tune", "population"} & type(study).model_fields.keys()
    tables = resolved(study) | {name: {} for name in searches}
    put(tables, path.split("."), float(value))
    try:
        validate(type(study), tables, where)
    except InputError as error:
        problem = error.mistakes[0].problem
        return [Mistake(where, f"reaches {value:g}, which is not allowed there: {problem}")]
    return []
