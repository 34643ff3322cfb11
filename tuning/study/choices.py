"""Choices between whole tables, such as which basis; every combination of their options is a study of its own."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

from tuning.files.errors import Mistake, input_error
from tuning.study.ranges import Axis

Choices = Mapping[str, Mapping[str, Mapping[str, Any]]]
"""Choice -> option -> dotted path -> what is put there: a value or a whole table."""
Chosen = dict[str, str]
"""Choice -> option."""
Setting = str | bool | int
"""What shapes a program: each value of it is compiled on its own."""
_MOST_STRUCTURES = 64
_SCORED_BY = "scorer"
"""The table by which options are compared: it is no option itself."""


def combinations(choices: Choices) -> list[Chosen]:
    """Return every combination of options, the last choice's running fastest; one empty one of no choices."""
    return [dict(zip(choices, options, strict=True)) for options in itertools.product(*choices.values())]


def settings_of(choices: Choices, chosen: Chosen) -> dict[str, Any]:
    """Return what a combination sets by path: whole tables ahead of what lies in them."""
    found = {path: value for name, option in chosen.items() for path, value in choices[name][option].items()}
    return dict(sorted(found.items(), key=lambda item: item[0].count(".")))


def label(chosen: Chosen) -> str:
    """Return a combination for people."""
    return ", ".join(f"{name} = {option}" for name, option in chosen.items())


def check_options(axis: Axis, own: Setting, where: str) -> list[Mistake]:
    """Return what is wrong with an axis over a setting; `own` is the study's."""
    if axis.options is not None:
        return []
    values = axis.values or []
    if isinstance(own, str | bool):
        fix = "true,false" if isinstance(own, bool) else "residual,sensor"
        return [Mistake(where, f"got numbers; needs options as {own!r} is", f"e.g. {fix}")]
    if axis.values is None:
        return [Mistake(where, "got a range; whole numbers are listed", "e.g. 2,4,6")]
    return [Mistake(where, f"got {v:g}; needs whole numbers", "e.g. 2,4,6") for v in values if v != int(v)][:1]


def options_of(axis: Axis, own: Setting) -> list[Setting]:
    """Return the values of an axis over a setting, which `check_options` found to be right."""
    if axis.options is not None:
        return list(axis.options)
    return [int(value) for value in axis.values or []]


def require_few(axes: Mapping[str, Sequence[Setting]], place: str) -> None:
    """Refuse more combinations of settings than anybody would compile.

    Raises:
        InputError: names their number.
    """
    count = math.prod(map(len, axes.values()))
    if count > _MOST_STRUCTURES:
        problem = f"makes {count} structures, each a program of its own; allowed: {_MOST_STRUCTURES}"
        raise input_error(f"{place} ({', '.join(axes)})", problem, "sweep some of them at a time")


def check_choices(choices: Choices, varied: Sequence[str], place: str) -> list[Mistake]:
    """Return what is wrong with choices before any study is made of them; `varied` are the tables that can be."""
    mistakes, setters = [], {}
    roots = [name for name in varied if name != _SCORED_BY]
    for name, options in choices.items():
        if not options:
            fix = 'add some, e.g. lean = { "estimator.basis.deflection_terms" = 2 }'
            mistakes.append(Mistake(f"{place}: tune.choices.{name}", "has no option", fix))
        for option, settings in options.items():
            for path in settings:
                where = f"{place}: tune.choices.{name}.{option}.{path!r}"
                if path.split(".")[0] not in roots:
                    problem = "is not a path that can be chosen"
                    mistakes.append(Mistake(where, problem, f"paths begin with {', '.join(roots)}"))
                other = setters.setdefault(path, name)
                if other != name:
                    fix = "set it in one of them: their options are combined"
                    mistakes.append(Mistake(where, f"is set by tune.choices.{other} too", fix))
    return mistakes


def blame(mistake: Mistake, choices: Choices, chosen: Chosen, place: str) -> Mistake:
    """Return a mistake of a combination's study, placed at the option that sets what is wrong.

    Args:
        mistake: its place is a path in the combination's study.
        choices: the choices.
        chosen: the combination.
        place: source of the study that has the choices.
    """
    setters = [
        (len(path), name, option)
        for name, option in chosen.items()
        for path in choices[name][option]
        if f"{mistake.place}.".startswith(f"{path}.") or path.startswith(f"{mistake.place}.")
    ]
    if not setters:
        # Nobody set it: it is wrong, or lacks, beside what was chosen.
        return Mistake(f"{place}: tune.choices ({label(chosen)}): {mistake.place}", mistake.problem, mistake.fix)
    _, name, option = max(setters)
    return Mistake(
        f"{place}: tune.choices.{name}.{option}.{mistake.place!r}",
        mistake.problem,
        mistake.fix or 'a table is replaced whole by "path.of.it" = { … }',
    )
