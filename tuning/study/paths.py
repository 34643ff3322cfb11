"""The numbers and settings of a study by their dotted paths: what can be varied."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import Any

from tuning.files.errors import Mistake
from tuning.study.base import Base, Study
from tuning.study.choices import Setting
from tuning.study.parts.base import Part


def numeric_paths(config: Base) -> dict[str, float]:
    """Return every number of a study by its dotted path: what can be varied, swept and tuned."""
    found: dict[str, float] = {}

    def walk(prefix: str, value: Any) -> None:
        if isinstance(value, Part):
            for name in type(value).model_fields:
                if name not in value.static:
                    walk(f"{prefix}.{name}", getattr(value, name))
        elif isinstance(value, float):
            found[prefix] = value

    for part in config.varied:
        walk(part, getattr(config, part, None))
    return found


def contested_number(config: Study) -> tuple[str, float]:
    """Return a number to name as an example of what can be varied: the first of what is tuned and compared."""
    numbers = numeric_paths(config).items()
    return next(((path, value) for path, value in numbers if path.split(".")[0] in config.contested), ("a.b", 1.0))


def structural_paths(config: Base) -> dict[str, Setting]:
    """Return every setting of the bench that shapes a program, by its path: texts, switches and whole numbers."""
    found: dict[str, Setting] = {}

    def walk(prefix: str, value: Any) -> None:
        if isinstance(value, Part):
            for name in type(value).model_fields:
                walk(f"{prefix}.{name}", getattr(value, name))
        elif isinstance(value, str | bool | int):
            found[prefix] = value

    for part in config.varied:
        walk(part, getattr(config, part, None))
    return found


def check_path(path: str, where: str, numbers: Mapping[str, object]) -> list[Mistake]:
    """Return what is wrong with a dotted path that should lead to a number of a study."""
    if path in numbers:
        return []
    near = difflib.get_close_matches(path, numbers, 3, 0.5)
    fix = f"did you mean {' or '.join(near)}?" if near else "`vsajax check STUDY` lists every number"
    return [Mistake(where, "leads to no number of the study", fix)]
