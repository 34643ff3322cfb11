"""What C computes: expressions over places, with indices that are affine in a loop variable or looked up."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any, Literal

Type = Literal["real", "int", "bool"]
Role = Literal["given", "state", "local", "carried", "result"]
Loop = tuple[str, int, int]
"""Loop variable, first value, end."""


@dataclass(frozen=True)
class Index:
    """offset + scale · variable + chosen; a constant where there is neither variable nor chosen.

    Args:
        offset: a number.
        variable: of a loop.
        scale: of the variable.
        chosen: a whole number that is computed, such as where a pivot lies.
    """

    offset: int = 0
    variable: str | None = None
    scale: int = 1
    chosen: Expression | None = None

    @property
    def is_constant(self) -> bool:
        """Whether it is a number."""
        return self.variable is None and self.chosen is None

    def shifted(self, by: int) -> Index:
        """Return the index `by` further."""
        return replace(self, offset=self.offset + by)

    def scaled(self, by: int) -> Index:
        """Return the index `by` times."""
        chosen = self.chosen
        if chosen is not None and by != 1:
            chosen = Apply("mul", (chosen, Number(by, "int")), "int")
        return Index(by * self.offset, self.variable, by * self.scale, chosen)

    def plus(self, other: Index) -> Index:
        """Return the sum of two indices."""
        offset = self.offset + other.offset
        if None in (self.variable, other.variable) and None in (self.chosen, other.chosen):
            varied = other if self.variable is None else self
            return Index(offset, varied.variable, varied.scale, self.chosen or other.chosen)
        terms = tuple(one.shifted(-one.offset).expression() for one in (self, other))
        return Index(offset, chosen=Apply("add", terms, "int"))

    def expression(self) -> Expression:
        """Return the index as a number to compute with."""
        if self.is_constant:
            return Number(self.offset, "int")
        is_bare = self.chosen is not None and self.variable is None and not self.offset
        return self.chosen if self.chosen is not None and is_bare else Position(self)


Indices = tuple[Index, ...]


@dataclass(eq=False)
class Storage:
    """A place that holds numbers: a member of a struct, a local variable, or a table.

    Args:
        name: as C calls it.
        indices: constant leading indices, e.g. of a row in a matrix.
        shape: of what lies there.
        type: of its elements.
        role: "given" by the caller and never written; "state", read before it is written; "local", written once;
            "carried" from turn to turn of a loop, or collected there; "result".
        group: locals of one group may become one array.
        is_inner: it only lives within one turn of a fused loop.
        is_wide: it is a running sum, double whatever `real` is; see `widths`.
    """

    name: str
    indices: Indices
    shape: tuple[int, ...]
    type: Type
    role: Role
    group: str = ""
    is_inner: bool = False
    is_wide: bool = False

    @property
    def declared(self) -> str:
        """Its type, as the source declares it."""
        return "double" if self.is_wide else self.type

    @property
    def is_local(self) -> bool:
        """Whether it is a variable of the function."""
        return self.role in {"local", "carried"}

    def is_same(self, other: Storage) -> bool:
        """Return whether both are the same place; variables have no name yet."""
        if self.is_local or other.is_local:
            return self is other
        return self.name == other.name and self.indices == other.indices


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
    """Return every place that an expression reads, those that its indices read too."""
    if isinstance(expression, Read):
        return [expression, *_looked_up(expression.indices)]
    if isinstance(expression, Position):
        return _looked_up((expression.index,))
    if isinstance(expression, Apply):
        return [read for argument in expression.arguments for read in reads(argument)]
    return []


def _looked_up(indices: Indices) -> list[Read]:
    return [read for index in indices if index.chosen is not None for read in reads(index.chosen)]


def rewritten(expression: Expression, change: Callable[[Read], Read]) -> Expression:
    """Return an expression with every read changed, those in its indices too."""
    if isinstance(expression, Read):
        return change(replace(expression, indices=_indices_rewritten(expression.indices, change)))
    if isinstance(expression, Position):
        (index,) = _indices_rewritten((expression.index,), change)
        return replace(expression, index=index)
    if isinstance(expression, Apply):
        return replace(expression, arguments=tuple(rewritten(a, change) for a in expression.arguments))
    return expression


def _indices_rewritten(indices: Indices, change: Callable[[Read], Read]) -> Indices:
    return tuple(
        index if index.chosen is None else replace(index, chosen=rewritten(index.chosen, change))
        for index in indices
    )


@dataclass(eq=False)
class Assign:
    """target[indices] = expression, or an accumulation, over all loops.

    Args:
        target: where to.
        indices: into it.
        value: what.
        loops: outermost first.
        inner: loops over which values are accumulated into the target.
        combine: with `inner`: "sum", "product", "max", "min", "and", "or"; "place" where the value, which may read
            the target, takes its place at every turn, and 0 is there first.
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


@dataclass(eq=False)
class Repeat:
    """A loop around statements that hand on to each other what they carry.

    Args:
        loop: the loop.
        body: its statements.
        place: in the source.
        collected: arrays of which every turn writes a row.
        fused: in the end the body with long loops fused, see `fusing`.
    """

    loop: Loop
    body: list[Assign | Repeat]
    place: str = ""
    collected: list[Storage] = field(default_factory=list)
    fused: list[Any] = field(default_factory=list)

    @property
    def times(self) -> int:
        """How many turns it has."""
        _, start, end = self.loop
        return end - start


def assigns(statements: Iterable[Assign | Repeat]) -> Iterator[Assign]:
    """Yield every assignment, those in loops too."""
    for statement in statements:
        if isinstance(statement, Repeat):
            yield from assigns(statement.body)
        else:
            yield statement
