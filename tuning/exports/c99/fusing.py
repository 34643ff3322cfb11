"""Long loops over the same range become one, and arrays that only live within it become numbers.

Without it, what a window's weights are made of would stand in memory as whole arrays. Long sums over one range
share a loop too: a processor adds several at a time, where one alone waits for each addition.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field

from tuning.exports.c99.expressions import (
    Assign,
    Expression,
    Index,
    Loop,
    Read,
    Repeat,
    Storage,
    assigns,
    reads,
    rewritten,
)

_LONG = 64
"""Turns of a loop from which it is worth it."""


@dataclass(eq=False)
class Block:
    """A loop around statements.

    Args:
        loop: the loop.
        body: statements, their own loops inside it.
    """

    loop: Loop
    body: list[Assign] = field(default_factory=list)


@dataclass(eq=False)
class Sums:
    """Sums over the same range.

    Args:
        loop: over the range.
        body: the sums.
    """

    loop: Loop
    body: list[Assign] = field(default_factory=list)


Statement = Assign | Block | Sums | Repeat


def fuse(statements: Sequence[Assign | Repeat]) -> list[Statement]:
    """Return the statements with long loops fused, in an order that changes no result."""
    fused: list[Statement] = []
    for statement in statements:
        if isinstance(statement, Repeat):
            statement.fused = fuse(statement.body)
            fused.append(statement)
            continue
        if _is_long_sum(statement):
            sums = _companions(fused, statement)
            if sums is None:
                sums = Sums(statement.inner[0])
                fused.append(sums)
            sums.body.append(statement)
            continue
        if not _is_long(statement):
            fused.insert(_earliest(fused, statement), statement)
            continue
        home = _home(fused, statement)
        if home is None:
            home = Block(statement.loops[0])
            fused.append(home)
        home.body.append(statement)
    blocks = [one for one in fused if isinstance(one, Block)]
    for number, block in enumerate(blocks):
        _contract(block, fused, number)
    # The block's loop runs around what is left of each statement's own.
    for block in blocks:
        for statement in block.body:
            statement.loops = statement.loops[1:]
    return [one.body[0] if isinstance(one, Block) and _unfused(one) else one for one in fused]


def _unfused(block: Block) -> bool:
    """Put a loop that stands alone back into its statement."""
    if len(block.body) > 1:
        return False
    block.body[0].loops = (block.loop, *block.body[0].loops)
    return True


def _is_long(s: Assign) -> bool:
    if not s.loops or s.loops[0][2] - s.loops[0][1] < _LONG or not s.indices:
        return False
    # A shift within one array must run as the one move that it is.
    is_shift = any(_key(r.storage) == _key(s.target) and r.indices != s.indices for r in reads(s.value))
    return s.indices[0] == Index(0, s.loops[0][0]) and not is_shift


def _home(fused: list[Statement], s: Assign) -> Block | None:
    """Return the nearest block before a statement that it can join."""
    for other in reversed(fused):
        if (
            isinstance(other, Block)
            and other.loop == s.loops[0]
            and all(_can_share(mine, s) for mine in other.body)
        ):
            return other
        if any(_conflict(one, s) for one in _parts(other)):
            return None
    return None


def _is_long_sum(s: Assign) -> bool:
    is_sum = s.combine == "sum" and not s.loops and len(s.inner) == 1
    return is_sum and s.inner[0][2] - s.inner[0][1] >= _LONG


def _companions(fused: list[Statement], s: Assign) -> Sums | None:
    """Return the nearest sums before a statement that it can join."""
    for other in reversed(fused):
        if any(_conflict(one, s) for one in _parts(other)):
            return None
        if isinstance(other, Sums) and other.loop == s.inner[0]:
            return other
    return None


def _parts(statement: Statement) -> list[Assign]:
    return list(assigns([statement] if isinstance(statement, Assign | Repeat) else statement.body))


def _earliest(fused: list[Statement], s: Assign) -> int:
    """Return where a statement goes: a number ahead of long loops that do not need it, so that they can join."""
    place = len(fused)
    while not s.loops and not s.inner and place and isinstance(fused[place - 1], Block):
        block = fused[place - 1]
        if not isinstance(block, Block) or any(_conflict(one, s) for one in block.body):
            break
        place -= 1
    return place


def _can_share(first: Assign, second: Assign) -> bool:
    """Return whether two statements may run turn by turn instead of one after the other."""
    here = Index(0, second.loops[0][0])
    if _key(first.target) == _key(second.target):
        return False
    own = all(r.indices[:1] == (here,) for r in reads(second.value) if _key(r.storage) == _key(first.target))
    return own and all(
        r.indices[:1] == (here,) for r in reads(first.value) if _key(r.storage) == _key(second.target)
    )


def _conflict(first: Assign, second: Assign) -> bool:
    """Return whether the second statement must stay behind the first."""
    written, later = _key(first.target), _key(second.target)
    return (
        written == later
        or any(_key(r.storage) == written for r in reads(second.value))
        or any(_key(r.storage) == later for r in reads(first.value))
    )


def _key(storage: Storage) -> Hashable:
    return id(storage) if storage.is_local else (storage.name, storage.indices)


def _contract(block: Block, fused: list[Statement], number: int) -> None:
    """Make numbers, or smaller arrays, of the locals that only this block uses, each turn its own."""
    here = Index(0, block.loop[0])
    outside = {
        id(r.storage)
        for one in fused
        if one is not block
        for s in _parts(one)
        for r in (*reads(s.value), Read(s.target, s.indices))
    }
    inside = [r for s in block.body for r in (*reads(s.value), Read(s.target, s.indices))]
    elsewhere = {id(r.storage) for r in inside if r.indices[:1] != (here,)}
    mine = {id(s.target): s.target for s in block.body if s.target.role == "local"}
    gone = {key: one for key, one in mine.items() if key not in outside | elsewhere}
    for storage in gone.values():
        storage.shape = storage.shape[1:]
        storage.group, storage.is_inner = f"{storage.group}#{number}", True
    for s in block.body:
        s.value = _without(s.value, gone)
        if id(s.target) in gone:
            s.indices = s.indices[1:]


def _without(e: Expression, gone: dict[int, Storage]) -> Expression:
    return rewritten(e, lambda r: Read(r.storage, r.indices[1:]) if id(r.storage) in gone else r)
