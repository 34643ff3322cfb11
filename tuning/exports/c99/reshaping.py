"""The same numbers in another shape."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tuning.exports.c99.expressions import Apply, Expression, Index, Indices, Number, Type
from tuning.exports.c99.values import ZERO, Value
from tuning.exports.flatten import Equation


def reshaped(equation: Equation, given: list[Value], kind: Type) -> list[Value]:
    """Look at the same numbers, row by row, in another shape."""
    (one,), shape = given, equation.outputs[0].shape

    def at(i: Indices) -> Expression:
        places = []
        for inner, outer in _shared(one.shape, shape):
            whole = ZERO
            for axis in outer:
                whole = whole.scaled(shape[axis]).plus(i[axis])
            places += _unravelled(whole, [one.shape[axis] for axis in inner])
        return one.at(tuple(places))

    return [Value(shape, kind, at)]


def _shared(one: tuple[int, ...], other: tuple[int, ...]) -> Iterator[tuple[list[int], list[int]]]:
    """Yield the axes of two shapes that have the same numbers between them, as few at a time as can be."""
    i = j = 0
    while i < len(one) or j < len(other):
        mine, its = [], []
        sizes = [1, 1]
        while not (mine or its) or sizes[0] != sizes[1]:
            if (sizes[0] <= sizes[1] and i < len(one)) or j == len(other):
                mine.append(i)
                sizes[0] *= one[i]
                i += 1
            else:
                its.append(j)
                sizes[1] *= other[j]
                j += 1
        yield mine, its


def _unravelled(whole: Index, shape: list[int]) -> list[Index]:
    """Return the place of a number in an array, from its place row by row."""
    long = [n for n in shape if n > 1]
    if len(long) < 2:
        return [whole if n > 1 else ZERO for n in shape]
    if whole.is_constant:
        return [Index(int(n)) for n in np.unravel_index(whole.offset, shape)]
    places, stride = [], int(np.prod(shape))
    for n in shape:
        stride //= n
        row = Apply("div", (whole.expression(), Number(stride, "int")), "int")
        column = Apply("rem", (row if stride > 1 else whole.expression(), Number(n, "int")), "int")
        places.append(Index(chosen=column) if n > 1 else ZERO)
    return places
