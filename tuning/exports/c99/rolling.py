"""Statements that differ only in a running index become one loop: what was unrolled in Python is rolled up in C.

A loop runs its statements in the order in which they stood, so nothing has to be known about what depends on what.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from tuning.exports.c99.expressions import (
    Apply,
    Assign,
    Expression,
    Index,
    Indices,
    Loop,
    Number,
    Position,
    Read,
    Storage,
    reads,
)

_FEWEST = 3
"""Statements that are worth a loop."""
_FEWEST_TERMS = 4
"""Terms of a sum that are worth a loop."""
_VARIABLES = "klmnij"


def roll(statements: Sequence[Assign], taken: set[str]) -> list[Assign]:
    """Return the statements with every run of like ones as a loop, and every long sum of like terms as one.

    Args:
        statements: in order.
        taken: names that are in use; those of new variables are added.
    """
    statements = [summed for statement in statements for summed in _with_sums(statement, taken)]
    rolled, at = [], 0
    while at < len(statements):
        run = _run(statements, at)
        if run is None:
            rolled.append(statements[at])
            at += 1
        else:
            loop, count = run
            rolled.append(loop)
            at += count
    return rolled


def _run(statements: Sequence[Assign], at: int) -> tuple[Assign, int] | None:
    first = statements[at]
    if at + _FEWEST > len(statements) or first.inner:
        return None
    steps = _steps(first, statements[at + 1])
    if steps is None or not any(steps):
        return None
    count = 2
    while at + count < len(statements) and _steps(first, statements[at + count]) == [n * count for n in steps]:
        count += 1
    if count < _FEWEST:
        return None
    taken = {name for name, _, _ in first.loops}
    variable = next(v for v in _VARIABLES if v not in taken)
    moving = _Moving(variable, iter(steps))
    target = replace(first.target, indices=moving.indices(first.target.indices))
    indices = moving.indices(first.indices)
    value = moving.expression(first.value)
    loops = ((variable, 0, count), *first.loops)
    return Assign(target, indices, value, loops, place=first.place), count


def _steps(one: Assign, other: Assign) -> list[int] | None:
    """Return how far every index of one statement lies before that of another; `None` if they differ otherwise."""
    if one.loops != other.loops or other.inner or one.target.name != other.target.name:
        return None
    steps: list[int] = []
    mine, its = one.target.indices + one.indices, other.target.indices + other.indices
    if _compare_indices(mine, its, steps) and _compare(one.value, other.value, steps):
        return steps
    return None


def _compare(one: Expression, other: Expression, steps: list[int]) -> bool:
    if isinstance(one, Number):
        return isinstance(other, Number) and one == other
    if isinstance(one, Position):
        return isinstance(other, Position) and _compare_indices((one.index,), (other.index,), steps)
    if isinstance(one, Read):
        if not isinstance(other, Read) or one.storage.name != other.storage.name:
            return False
        return _compare_indices(one.full, other.full, steps)
    if (
        not isinstance(other, Apply)
        or one.operation != other.operation
        or len(one.arguments) != len(other.arguments)
    ):
        return False
    return all(_compare(a, b, steps) for a, b in zip(one.arguments, other.arguments, strict=True))


def _compare_indices(one: Indices, other: Indices, steps: list[int]) -> bool:
    if len(one) != len(other):
        return False
    for a, b in zip(one, other, strict=True):
        if a != b and not (a.is_constant and b.is_constant):
            return False
        steps.append(b.offset - a.offset)
    return True


@dataclass
class _Moving:
    """Puts a loop's variable where indices step, in the order in which they were compared."""

    variable: str
    steps: Iterator[int]

    def indices(self, indices: Indices) -> Indices:
        """Return indices that move with the loop."""
        return tuple(self._index(index) for index in indices)

    def _index(self, index: Index) -> Index:
        step = next(self.steps)
        return Index(index.offset, self.variable, step) if step else index

    def expression(self, e: Expression) -> Expression:
        """Return an expression that moves with the loop."""
        if isinstance(e, Position):
            return Position(self._index(e.index))
        if isinstance(e, Read):
            storage = replace(e.storage, indices=self.indices(e.storage.indices))
            return Read(storage, self.indices(e.indices))
        if isinstance(e, Apply):
            return Apply(e.operation, tuple(self.expression(a) for a in e.arguments), e.type)
        return e


def _with_sums(statement: Assign, taken: set[str]) -> list[Assign]:
    """Return a statement with its long sums of like terms accumulated in loops, in front of it where need be.

    The terms are added in the order in which they stood, from zero on, so not a bit changes.
    """
    if statement.inner:
        return [statement]
    whole = _sum_loop(statement.value, statement.loops)
    if whole is not None:
        if any(read.storage.name == statement.target.name for read in reads(statement.value)):
            return [statement]
        term, loop = whole
        return [replace(statement, value=term, inner=(loop,))]
    if statement.loops:
        return [statement]
    ahead: list[Assign] = []
    value = _hoisted(statement.value, statement, ahead, taken)
    return [*ahead, replace(statement, value=value)]


def _hoisted(e: Expression, statement: Assign, ahead: list[Assign], taken: set[str]) -> Expression:
    if not isinstance(e, Apply):
        return e
    found = _sum_loop(e, ())
    if found is None:
        return Apply(e.operation, tuple(_hoisted(a, statement, ahead, taken) for a in e.arguments), e.type)
    term, loop = found
    base = re.sub(r"\W+", "_", statement.target.name.rpartition(".")[2].rpartition(">")[2])
    name = next(n for n in (f"{base}_sum{i or ''}" for i in range(len(taken) + 1)) if n not in taken)
    taken.add(name)
    storage = Storage(name, (), (), "real", "local")
    ahead.append(Assign(storage, (), term, (), (loop,), place=statement.place))
    return Read(storage, ())


def _sum_loop(e: Expression, loops: tuple[Loop, ...]) -> tuple[Expression, Loop] | None:
    """Return the term of a long sum of like ones, and the loop over it."""
    terms: list[Expression] = []
    while isinstance(e, Apply) and e.operation == "add":
        terms.insert(0, e.arguments[1])
        e = e.arguments[0]
    terms.insert(0, e)
    if len(terms) < _FEWEST_TERMS:
        return None
    steps: list[int] = []
    if not _compare(terms[0], terms[1], steps) or not any(steps):
        return None
    for n, term in enumerate(terms[2:], 2):
        further: list[int] = []
        if not _compare(terms[0], term, further) or further != [n * step for step in steps]:
            return None
    variable = next(v for v in _VARIABLES if v not in {name for name, _, _ in loops})
    return _Moving(variable, iter(steps)).expression(terms[0]), (variable, 0, len(terms))
