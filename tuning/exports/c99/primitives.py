"""What each of jax' operations is in C: an operation on elements, or another way to look at an array."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from tuning.exports.c99.expressions import Apply, Expression, Index, Indices, Number, Position, Type
from tuning.exports.c99.lookups import dynamic_slice, dynamic_update_slice, gathered
from tuning.exports.c99.reshaping import reshaped
from tuning.exports.c99.values import ZERO, Piece, Value, joined
from tuning.exports.flatten import Equation, Untraceable

BINARY = {"add", "sub", "mul", "div", "max", "min", "pow", "rem", "atan2"}
UNARY = {
    "neg", "abs", "sign", "floor", "ceil", "round", "sqrt", "rsqrt", "exp", "expm1", "log", "log1p", "tanh",
    "sinh", "cosh", "sin", "cos", "tan", "atan", "asin", "acos", "logistic", "is_finite",
}  # fmt: skip
COMPARISONS = {"eq", "ne", "lt", "le", "gt", "ge"}
LOGIC = {"and", "or", "not", "xor"}
REDUCTIONS = {
    "reduce_sum": "sum", "reduce_prod": "product", "reduce_max": "max", "reduce_min": "min", "reduce_and": "and",
    "reduce_or": "or",
}  # fmt: skip
EXTREMES = {"argmax": "gt", "argmin": "lt"}
_VIEWS = frozenset({"concatenate", "stack", "slice", "unstack", "split", "squeeze"})
_BIGGEST_POWER = 16


def type_of(dtype: np.dtype) -> Type:
    """Return C's type for one of numpy's.

    Raises:
        Untraceable: there is none.
    """
    kinds: dict[str, Type] = {"f": "real", "b": "bool", "i": "int", "u": "int"}
    if dtype.kind not in kinds:
        raise Untraceable(f"values of type {dtype} have no counterpart in the generated code")
    return kinds[dtype.kind]


def is_view(equation: Equation) -> bool:
    """Return whether an operation may look into the pieces of an array, at constant places only."""
    if equation.primitive == "reshape":
        shapes = (equation.inputs[0].shape, equation.outputs[0].shape)
        one, other = ([n for n in shape if n > 1] for shape in shapes)
        return one == other
    return equation.primitive in _VIEWS


def lower(equation: Equation, given: list[Value]) -> list[Value]:
    """Return the values of an equation that neither sums nor stores.

    Raises:
        Untraceable: the operation has no counterpart in C.
    """
    name, out = equation.primitive, equation.outputs[0]
    kind = type_of(out.dtype)
    if name == "round" and equation.params["rounding_method"] != jax.lax.RoundingMethod.TO_NEAREST_EVEN:
        raise Untraceable(
            f"rounding halves away from zero ({equation.origin.place}) has no counterpart; use jnp.round"
        )
    if name in BINARY | UNARY | COMPARISONS | LOGIC:
        return [_elementwise(name, given, out.shape, kind)]
    if name in _OTHERS:
        return _OTHERS[name](equation, given, kind)
    raise Untraceable(
        f"the operation {name} ({equation.origin.place or 'unknown place'}) has no counterpart in the generated "
        "code; write the step with elementwise operations, slices and sums"
    )


def _elementwise(name: str, given: list[Value], shape: tuple[int, ...], kind: Type) -> Value:
    return Value(shape, kind, lambda i: Apply(name, tuple(one.here(i, shape) for one in given), kind))


def _once(equation: Equation, given: list[Value], kind: Type) -> list[Value]:
    return [given[0]]


def _convert(equation: Equation, given: list[Value], kind: Type) -> list[Value]:
    (one,) = given
    if one.type == kind:
        return [one]
    return [Value(one.shape, kind, lambda i: _converted(one.at(i), kind))]


def _converted(expression: Expression, kind: Type) -> Expression:
    if isinstance(expression, Number):
        return Number(expression.value, kind)
    return Apply(f"to_{kind}", (expression,), kind)


def _select(equation: Equation, given: list[Value], kind: Type) -> list[Value]:
    which, *cases = given
    shape = equation.outputs[0].shape
    if len(cases) != 2 or which.type != "bool":
        raise Untraceable(f"a choice among {len(cases)} cases has no counterpart in the generated code")

    def at(i: Indices) -> Expression:
        no, yes = (case.here(i, shape) for case in cases)
        return Apply("select", (which.here(i, shape), yes, no), kind)

    return [Value(shape, kind, at)]


def _clamp(equation: Equation, given: list[Value], kind: Type) -> list[Value]:
    low, one, high = given
    shape = equation.outputs[0].shape

    def at(i: Indices) -> Expression:
        raised = Apply("max", (one.here(i, shape), low.here(i, shape)), kind)
        return Apply("min", (raised, high.here(i, shape)), kind)

    return [Value(shape, kind, at)]


def _square(equation: Equation, given: list[Value], kind: Type) -> list[Value]:
    return [Value(given[0].shape, kind, lambda i: Apply("mul", (given[0].at(i), given[0].at(i)), kind))]


def _integer_pow(equation: Equation, given: list[Value], kind: Type) -> list[Value]:
    power = equation.params["y"]
    if not 1 <= abs(power) <= _BIGGEST_POWER:
        raise Untraceable(f"the power {power} ({equation.origin.place}) is beyond {_BIGGEST_POWER}")

    def at(i: Indices) -> Expression:
        one = given[0].at(i)
        total = one
        for _ in range(abs(power) - 1):
            total = Apply("mul", (total, one), kind)
        return total if power > 0 else Apply("div", (Number(1.0, kind), total), kind)

    return [Value(given[0].shape, kind, at)]


def _iota(equation: Equation, given: list[Value], kind: Type) -> list[Value]:
    axis = equation.params["dimension"]

    def at(i: Indices) -> Expression:
        return Position(i[axis]) if kind == "int" else Apply("to_real", (Position(i[axis]),), "real")

    return [Value(equation.outputs[0].shape, kind, at)]


def _broadcast(equation: Equation, given: list[Value], kind: Type) -> list[Value]:
    (one,), axes = given, equation.params["broadcast_dimensions"]

    def at(i: Indices) -> Expression:
        return one.at(tuple(i[axis] if n > 1 else ZERO for axis, n in zip(axes, one.shape, strict=True)))

    return [Value(equation.outputs[0].shape, kind, at)]


def _slice(equation: Equation, given: list[Value], kind: Type) -> list[Value]:
    (one,), starts = given, equation.params["start_indices"]
    strides = equation.params["strides"] or (1,) * len(starts)

    def at(i: Indices) -> Expression:
        return one.at(tuple(n.scaled(step).shifted(s) for n, step, s in zip(i, strides, starts, strict=True)))

    return [Value(equation.outputs[0].shape, kind, at)]


def _transpose(equation: Equation, given: list[Value], kind: Type) -> list[Value]:
    (one,), order = given, equation.params["permutation"]

    def at(i: Indices) -> Expression:
        inner = [ZERO] * len(order)
        for place, axis in enumerate(order):
            inner[axis] = i[place]
        return one.at(tuple(inner))

    return [Value(equation.outputs[0].shape, kind, at)]


def _rev(equation: Equation, given: list[Value], kind: Type) -> list[Value]:
    (one,), axes = given, equation.params["dimensions"]

    def at(i: Indices) -> Expression:
        flipped = [n.scaled(-1).shifted(one.shape[a] - 1) if a in axes else n for a, n in enumerate(i)]
        return one.at(tuple(flipped))

    return [Value(one.shape, kind, at)]


def _concatenate(equation: Equation, given: list[Value], kind: Type) -> list[Value]:
    axis, start, pieces = equation.params["dimension"], 0, []
    for one in given:
        pieces.append(Piece(axis, start, one))
        start += one.shape[axis]
    return [joined(equation.outputs[0].shape, kind, tuple(pieces))]


def _stack(equation: Equation, given: list[Value], kind: Type) -> list[Value]:
    axis, shape = equation.params["axis"], equation.outputs[0].shape

    def layer(one: Value) -> Value:
        flat = (*shape[:axis], 1, *shape[axis + 1 :])
        return Value(flat, kind, lambda i: one.at((*i[:axis], *i[axis + 1 :])))

    return [joined(shape, kind, tuple(Piece(axis, n, layer(one)) for n, one in enumerate(given)))]


def _unstack(equation: Equation, given: list[Value], kind: Type) -> list[Value]:
    (one,), axis = given, equation.params["axis"]

    def layer(n: int) -> Value:
        shape = equation.outputs[n].shape
        return Value(shape, kind, lambda i: one.at((*i[:axis], Index(n), *i[axis:])))

    return [layer(n) for n in range(len(equation.outputs))]


def _split(equation: Equation, given: list[Value], kind: Type) -> list[Value]:
    (one,), axis = given, equation.params["axis"]
    starts = np.cumsum([0, *equation.params["sizes"]])

    def part(n: int) -> Value:
        start = int(starts[n])
        return Value(
            equation.outputs[n].shape,
            kind,
            lambda i: one.at((*i[:axis], i[axis].shifted(start), *i[axis + 1 :])),
        )

    return [part(n) for n in range(len(equation.outputs))]


_OTHERS: dict[str, Callable[[Any, Any, Any], list[Value]]] = {
    "once": _once,
    "element": _once,
    "convert_element_type": _convert,
    "select_n": _select,
    "clamp": _clamp,
    "square": _square,
    "integer_pow": _integer_pow,
    "iota": _iota,
    "broadcast_in_dim": _broadcast,
    "slice": _slice,
    "squeeze": reshaped,
    "reshape": reshaped,
    "expand_dims": reshaped,
    "transpose": _transpose,
    "rev": _rev,
    "concatenate": _concatenate,
    "stack": _stack,
    "unstack": _unstack,
    "split": _split,
    "gather": gathered,
    "dynamic_slice": dynamic_slice,
    "dynamic_update_slice": dynamic_update_slice,
}
