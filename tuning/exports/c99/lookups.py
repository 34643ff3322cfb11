"""Rows and parts of an array at places that are computed."""

from __future__ import annotations

import jax
import numpy as np

from tuning.exports.c99.expressions import Apply, Expression, Index, Indices, Number, Position, Type
from tuning.exports.c99.values import ZERO, Value
from tuning.exports.flatten import Equation


def gathered(equation: Equation, given: list[Value], kind: Type) -> list[Value]:
    """Look rows up; where the mode asks for it, what lies outside is put at the edge or is no number."""
    one, where = given
    numbers, sizes = equation.params["dimension_numbers"], equation.params["slice_sizes"]
    mode, shape = equation.params["mode"], equation.outputs[0].shape
    gone = {*numbers.collapsed_slice_dims, *numbers.operand_batching_dims}
    kept = [axis for axis in range(len(one.shape)) if axis not in gone]

    def at(i: Indices) -> Expression:
        offsets = dict(zip(kept, (i[axis] for axis in numbers.offset_dims), strict=True))
        batch = tuple(i[axis] for axis in range(len(shape)) if axis not in numbers.offset_dims)
        places = [offsets.get(axis, ZERO) for axis in range(len(one.shape))]
        for axis, other in zip(numbers.operand_batching_dims, numbers.start_indices_batching_dims, strict=True):
            places[axis] = batch[other]
        inside: list[Expression] = []
        for n, axis in enumerate(numbers.start_index_map):
            start, last = where.at((*batch, Index(n))), one.shape[axis] - sizes[axis]
            if mode == jax.lax.GatherScatterMode.CLIP:
                start = _clipped(start, last)
            elif mode == jax.lax.GatherScatterMode.FILL_OR_DROP:
                inside += _bounds(start, last)
            places[axis] = places[axis].plus(_index(start))
        found: Expression = one.at(tuple(places))
        for condition in reversed(inside):
            found = Apply("select", (condition, found, Number(_absent(equation, kind), kind)), kind)
        return found

    return [Value(shape, kind, at)]


def _absent(equation: Equation, kind: Type) -> float:
    fill = equation.params["fill_value"]
    if fill is not None:
        return float(fill)
    if kind == "real":
        return float("nan")
    return 1.0 if kind == "bool" else float(np.iinfo(equation.outputs[0].dtype).min)


def dynamic_slice(equation: Equation, given: list[Value], kind: Type) -> list[Value]:
    """Look at a part that begins where it is computed; it is moved inside where it would reach out."""
    one, *starts = given
    shape = equation.outputs[0].shape

    def at(i: Indices) -> Expression:
        edges = zip(starts, one.shape, shape, strict=True)
        first = [_index(_clipped(start.at(()), whole - part)) for start, whole, part in edges]
        return one.at(tuple(n.plus(start) for n, start in zip(i, first, strict=True)))

    return [Value(shape, kind, at)]


def dynamic_update_slice(equation: Equation, given: list[Value], kind: Type) -> list[Value]:
    """Put a part over an array, beginning where it is computed; it is moved inside where it would reach out."""
    one, part, *starts = given

    def at(i: Indices) -> Expression:
        inside: list[Expression] = []
        places = []
        for n, start, whole, length in zip(i, starts, one.shape, part.shape, strict=True):
            first = _clipped(start.at(()), whole - length)
            place = Apply("sub", (n.expression(), first), "int")
            inside += _bounds(place, length - 1) if length < whole else []
            places.append(_index(place) if length < whole else n)
        found: Expression = part.at(tuple(places))
        for condition in reversed(inside):
            found = Apply("select", (condition, found, one.at(i)), kind)
        return found

    return [Value(one.shape, kind, at)]


def _index(place: Expression) -> Index:
    if isinstance(place, Number):
        return Index(int(place.value))
    return place.index if isinstance(place, Position) else Index(chosen=place)


def _bounds(place: Expression, last: int) -> list[Expression]:
    """Return the conditions for a place to lie within 0 and `last` that are not met for certain."""
    if isinstance(place, Number) and 0 <= place.value <= last:
        return []
    low = Apply("ge", (place, Number(0, "int")), "bool")
    return [low, Apply("le", (place, Number(last, "int")), "bool")]


def _clipped(place: Expression, last: int) -> Expression:
    if isinstance(place, Number):
        return Number(min(max(place.value, 0), last), "int")
    raised = Apply("max", (place, Number(0, "int")), "int")
    return Apply("min", (raised, Number(last, "int")), "int")
