"""What there is to say of a part, a kind, a score, a format or a paper: its sentence, and its numbers."""

from __future__ import annotations

from typing import Any

from tuning.study.extents import holds_number, range_in
from tuning.study.kinds import Kind
from tuning.study.parts.base import Part
from tuning.study.refs import Explained
from tuning.study.scores import Score


def summary_of(entry: Any) -> str:
    """Return what something says of itself, in a line."""
    if isinstance(entry, Score):
        return entry.title
    if isinstance(entry, Explained):
        return entry.summary
    described = entry.tables.load() if isinstance(entry, Kind) else entry
    return (described.__doc__ or "").strip().partition("\n")[0]


def numbers_of(entry: Any) -> dict[str, dict[str, Any]]:
    """Return the numbers of a part's table by name: where they may lie, and what they are if left out."""
    if not (isinstance(entry, type) and issubclass(entry, Part)):
        return {}
    found = {}
    for name, field in entry.model_fields.items():
        if not holds_number(field.annotation):
            continue
        allowed = range_in(field)
        told = {"low": allowed.low, "high": allowed.high}
        told |= {"is_low_open": allowed.is_low_open, "is_high_open": allowed.is_high_open}
        said = f"{name}: any number" if allowed.text == "finite" else allowed.text.replace("x", name)
        if not field.is_required():
            told["default"] = field.default
            said += "; absent if left out" if field.default is None else f"; {field.default:g} if left out"
        found[name] = told | {"said": said}
    return found
