"""Where a parameter may lie, read from the tables that a study file is validated with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from annotated_types import Ge, Gt, Le, Lt

from tuning.exports.layout import Path
from tuning.parts.estimators import AlgebraicObserver
from tuning.study import Config


@dataclass(frozen=True)
class Range:
    """Limits of a number; `None` where there is none, open where the limit itself is not allowed."""

    low: float | None = None
    high: float | None = None
    is_low_open: bool = False
    is_high_open: bool = False


def range_of(config: Config, path: Path) -> Range:
    """Return the range of the parameter at a path of the estimator."""
    part: Any = config.estimator
    *parents, last = [key for key in path if isinstance(key, str)]
    for key in parents:
        part = getattr(part, key)
    limits: dict[str, Any] = {}
    for constraint in type(part).model_fields[last].metadata:
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
