"""Where a parameter may lie, read from the tables that a study file is validated with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, get_args

from annotated_types import Ge, Gt, Le, Lt

from tuning.exports.layout import Path
from tuning.parts.base import Part
from tuning.parts.estimators import AlgebraicObserver


@dataclass(frozen=True)
class Range:
    """Limits of a number; `None` where there is none, open where the limit itself is not allowed."""

    low: float | None = None
    high: float | None = None
    is_low_open: bool = False
    is_high_open: bool = False


def range_of(parts: Mapping[tuple[str, ...], Part], path: Path) -> Range:
    """Return the range of the parameter at a path through one of the parts, each at its own path."""
    keys = [key for key in path if isinstance(key, str)]
    root = next(root for root in parts if tuple(keys[: len(root)]) == root)
    part: Any = parts[root]
    *parents, last = keys[len(root) :]
    for key in parents:
        part = getattr(part, key)
    limits: dict[str, Any] = {}
    field = type(part).model_fields[last]
    # The limits of `Positive | None` are those of its first option.
    options = [one for option in get_args(field.annotation) for one in getattr(option, "__metadata__", ())]
    for constraint in [*field.metadata, *options]:
        for inner in getattr(constraint, "metadata", [constraint]):
            if isinstance(inner, Gt | Ge):
                value = inner.gt if isinstance(inner, Gt) else inner.ge
                limits |= {"low": value, "is_low_open": isinstance(inner, Gt)}
            if isinstance(inner, Lt | Le):
                value = inner.lt if isinstance(inner, Lt) else inner.le
                limits |= {"high": value, "is_high_open": isinstance(inner, Lt)}
    if isinstance(part, AlgebraicObserver) and last == "window":
        limits |= {"low": 4 * part.sample_time, "is_low_open": False, "high": part.longest_window or part.window}
    return Range(**limits)
