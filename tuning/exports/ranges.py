"""Where parameters may lie, read from the tables that a study file is validated with."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from tuning.exports.layout import Path
from tuning.study.extents import Range, range_in
from tuning.study.parts.base import Part
from tuning.study.parts.estimators import AlgebraicObserver


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
    found = range_in(type(part).model_fields[last])
    if isinstance(part, AlgebraicObserver) and last == "window":
        longest = part.longest_window or part.window
        return replace(found, low=4 * part.sample_time, is_low_open=False, high=longest)
    return found
