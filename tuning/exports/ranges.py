"""Where parameters may lie, read from the tables that a study file is validated with."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, get_args

from annotated_types import Ge, Gt, Le, Lt

from tuning.exports.layout import Path
from tuning.study.parts.base import Part
from tuning.study.parts.estimators import AlgebraicObserver

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


@dataclass(frozen=True)
class Order:
    """Two parameters of one shape, the first of which must not exceed the second, number by number.

    Args:
        lower: path of the first.
        upper: path of the second.
        is_strict: whether they must not be equal either.
    """

    lower: Path
    upper: Path
    is_strict: bool


@dataclass(frozen=True)
class Limits:
    """All that is known of where the parameters of a program may lie.

    Args:
        ranges: one a parameter, in their order.
        orders: of pairs of them.
    """

    ranges: tuple[Range, ...]
    orders: tuple[Order, ...] = ()


def orders_of(parts: Mapping[tuple[str, ...], Part]) -> Iterator[Order]:
    """Yield the orders that a study file is held to, in all tables of the parts."""
    for path, part in parts.items():
        if part.ordered is not None:
            lower, upper, _ = part.ordered
            yield Order((*path, lower), (*path, upper), is_strict=True)
        inner = {(*path, name): getattr(part, name) for name in type(part).model_fields}
        yield from orders_of({place: table for place, table in inner.items() if isinstance(table, Part)})


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
