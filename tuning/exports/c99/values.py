"""Values during lowering: shapes, and what lies at an index."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tuning.exports.c99.expressions import Expression, Index, Indices, Read, Storage, Type

ZERO = Index(0)


@dataclass(frozen=True)
class Value:
    """An array that need not be stored: its elements are expressions.

    Args:
        shape: its dimensions.
        type: of the elements.
        at: what lies at an index.
        pieces: where the array is put together of parts along its first or another axis, see `Piece`.
    """

    shape: tuple[int, ...]
    type: Type
    at: Callable[[Indices], Expression]
    pieces: tuple[Piece, ...] = ()

    def here(self, indices: Indices, shape: tuple[int, ...]) -> Expression:
        """Return what lies at an index of an array of `shape`: along a dimension of one all is the same."""
        if self.shape in {shape, ()}:
            return self.at(indices if self.shape else ())
        return self.at(tuple(i if n > 1 else ZERO for i, n in zip(indices, self.shape, strict=True)))


@dataclass(frozen=True)
class Piece:
    """The part of an array that begins at `start` along `axis`."""

    axis: int
    start: int
    value: Value


def stored(storage: Storage) -> Value:
    """Return the value of a place."""
    return Value(storage.shape, storage.type, lambda indices: Read(storage, indices))


def joined(shape: tuple[int, ...], kind: Type, pieces: tuple[Piece, ...]) -> Value:
    """Return an array put together of pieces; it must be stored before a loop reads across them."""

    def at(indices: Indices) -> Expression:
        axis = pieces[0].axis
        index = indices[axis]
        if not index.is_constant:
            raise LookupError("a loop reads across the pieces of an array that is not stored")
        piece = max((p for p in pieces if p.start <= index.offset), key=lambda p: p.start)
        inner = (*indices[:axis], index.shifted(-piece.start), *indices[axis + 1 :])
        return piece.value.at(inner)

    return Value(shape, kind, at, pieces)
