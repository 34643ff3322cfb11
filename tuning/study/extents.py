"""Where a number of a table may lie, read from the annotation that files are validated with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, get_args

from annotated_types import Ge, Gt, Le, Lt
from pydantic.fields import FieldInfo

LARGEST, SMALLEST = 1e15, 1e-30
"""Largest magnitude of an exported parameter in SI units, and the smallest of one that must be positive."""


@dataclass(frozen=True)
class Range:
    """Limits of a number; `None` where there is none, open where the limit itself is not allowed."""

    low: float | None = None
    high: float | None = None
    is_low_open: bool = False
    is_high_open: bool = False

    @property
    def text(self) -> str:
        """For people, e.g. "0 < x ≤ 1"; infinity is in no range."""
        left = "" if self.low is None else f"{self.low:.12g} {'<' if self.is_low_open else '≤'} "
        right = "" if self.high is None else f" {'<' if self.is_high_open else '≤'} {self.high:.12g}"
        return f"{left}x{right}" if left or right else "finite"

    @property
    def practical(self) -> Range:
        """The same within magnitudes of which powers do not overflow: what a running program takes."""
        low, is_low_open = (-LARGEST, False) if self.low is None else (self.low, self.is_low_open)
        if low == 0.0 and is_low_open:
            low, is_low_open = SMALLEST, False
        high, is_high_open = (LARGEST, False) if self.high is None else (self.high, self.is_high_open)
        return Range(low, high, is_low_open, is_high_open)


def range_in(field: FieldInfo) -> Range:
    """Return where the number in a field may lie, whatever the table's other fields are."""
    limits: dict[str, Any] = {}
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
    return Range(**limits)


def holds_number(annotation: Any) -> bool:
    """Return whether a field is a number, or a number or nothing."""
    if annotation in (float, int):
        return True
    return any(holds_number(getattr(option, "__origin__", option)) for option in get_args(annotation))
