"""What C computes: expressions over places, with indices that are affine in a loop variable."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Literal

Type = Literal["real", "int", "bool"]
Role = Literal["given", "state", "local", "result"]
Loop = tuple[str, int, int]
"""Loop variable, first value, end."""


@dataclass(frozen=True)
class Index:
    """offset + scale · variable; a constant where there is no variable."""

    offset: int = 0
    variable: str | None = None
    scale: int = 1

    def shifted(self, by: int) -> Index:
        """Return the index `by` further."""
        return Index(self.offset + by, self.variable, self.scale)

    def scaled(self, by: int) -> Index:
        """Return the index `by` times."""
        return Index(by * self.offset, self.variable, by * self.scale)

    def __str__(self) -> str:
        if self.variable is None:
            return str(self.offset)
        text = self.variable if self.scale == 1 else f"{self.scale} * {self.variable}"
        if self.offset:
            text = f"{text} {'+' if self.offset > 0 else '-'} {abs(self.offset)}"
        return text


Indices = tuple[Index, ...]


@dataclass(eq=False)
class Storage:
    """A place that holds numbers: a member of a struct, a local variable, or a table.

    Args:
        name: as C calls it.
        indices: constant leading indices, e.g. of a row in a matrix.
        shape: of what lies there.
        type: of its elements.
        role: "given" by the caller and never written; "state", read before it is written; "local"; "result".
        group: locals of one group may become one array.
        is_inner: it only lives within one turn of a fused loop.
    """

    name: str
    indices: Indices
    shape: tuple[int, ...]
    type: Type
    role: Role
    group: str = ""
    is_inner: bool = False


@dataclass(frozen=True)
class Read:
    """The number at an index of a place."""

    storage: Storage
    indices: Indices

    @property
    def type(self) -> Type:
        """Of the number."""
        return self.storage.type

    @property
    def full(self) -> Indices:
        """All indices, those of the storage first."""
        return self.storage.indices + self.indices


@dataclass(frozen=True)
class Number:
    """A constant."""

    value: float
    type: Type


@dataclass(frozen=True)
class Position:
    """The value of an index."""

    index: Index
    type: Type = "int"


@dataclass(frozen=True)
class Apply:
    """An operation on expressions.

    Args:
        operation: e.g. "add"; see `printing`.
        arguments: its operands.
        type: of the result.
    """

    operation: str
    arguments: tuple[Expression, ...]
    type: Type


Expression = Read | Number | Position | Apply


def operations(expression: Expression) -> Counter[str]:
    """Return how often each operation occurs; those on indices and whole numbers are not counted."""
    counted: Counter[str] = Counter()
    if isinstance(expression, Apply):
        if expression.type != "int":
            counted[expression.operation] += 1
        for argument in expression.arguments:
            counted += operations(argument)
    return counted


def size(expression: Expression) -> int:
    """Return how many operations an expression has."""
    return sum(operations(expression).values())


def reads(expression: Expression) -> list[Read]:
    """Return every place that an expression reads."""
    if isinstance(expression, Read):
        return [expression]
    if isinstance(expression, Apply):
        return [read for argument in expression.arguments for read in reads(argument)]
    return []


@dataclass(eq=False)
class Assign:
    """target[indices] = expression, or an accumulation, over all loops.

    Args:
        target: where to.
        indices: into it.
        value: what.
        loops: outermost first.
        inner: loops over which values are accumulated into the target.
        combine: "sum", "max", "min" with `inner`.
        place: in the source.
    """

    target: Storage
    indices: Indices
    value: Expression
    loops: tuple[Loop, ...] = ()
    inner: tuple[Loop, ...] = ()
    combine: str = "sum"
    place: str = ""

    @property
    def times(self) -> int:
        """How often the value is computed."""
        total = 1
        for _, start, end in (*self.loops, *self.inner):
            total *= end - start
        return total
