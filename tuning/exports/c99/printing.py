"""Statements as C99 text."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tuning.exports.c99.expressions import (
    Apply,
    Assign,
    Expression,
    Index,
    Loop,
    Number,
    Position,
    Read,
    Storage,
)
from tuning.exports.c99.widths import fitted

WIDTH = 100
_TINY = float(np.finfo(np.float64).tiny)
_EPSILON = float(np.finfo(np.float64).eps)

# Precedence of C's operators: what binds tighter has the higher number.
_INFIX = {
    "mul": ("*", 12), "div": ("/", 12), "rem": ("%", 12), "add": ("+", 11), "sub": ("-", 11),
    "lt": ("<", 10), "le": ("<=", 10), "gt": (">", 10), "ge": (">=", 10), "eq": ("==", 9), "ne": ("!=", 9),
    "and": ("&&", 5), "or": ("||", 4), "xor": ("!=", 9),
}  # fmt: skip
_ATOM, _UNARY, _SUM, _BOTH, _CHOICE = 20, 14, 11, 6, 3
_LESSER = {"max": ">", "min": "<"}
_COMPARED = frozenset({"lt", "le", "gt", "ge", "eq", "ne", "xor"})
FUNCTIONS = {
    "sqrt": "sqrt", "exp": "exp", "expm1": "expm1", "log": "log", "log1p": "log1p", "tanh": "tanh",
    "sinh": "sinh", "cosh": "cosh", "sin": "sin", "cos": "cos", "tan": "tan", "atan": "atan", "asin": "asin",
    "acos": "acos", "atan2": "atan2", "abs": "fabs", "floor": "floor", "ceil": "ceil", "round": "rint",
    "pow": "pow", "rem": "fmod",
}  # fmt: skip
"""Operations that are functions of <math.h>; in single precision with an f behind the name.

`round` is rint, which rounds halves to even as jax' default for even numbers does; see `jnp.round`.
"""
HELPERS = {
    "max": "static inline real r_max(real a, real b)\n{\n    return (a > b || isnan(a)) ? a : b;\n}\n",
    "min": "static inline real r_min(real a, real b)\n{\n    return (a < b || isnan(a)) ? a : b;\n}\n",
    "wide_max": "static inline double wide_max(double a, double b)\n{\n"
    "    return (a > b || isnan(a)) ? a : b;\n}\n",
    "wide_min": "static inline double wide_min(double a, double b)\n{\n"
    "    return (a < b || isnan(a)) ? a : b;\n}\n",
    "sign": "static inline real r_sign(real a)\n{\n"
    "    return a > R(0.0) ? R(1.0) : (a < R(0.0) ? R(-1.0) : a);\n}\n",
}
"""Operations that C lacks; a number that is not one stays so, as in jax."""


def expression(e: Expression, strength: int = 0) -> str:
    """Return an expression's text, in parentheses where what surrounds it binds at least as tightly."""
    text, own = _with_strength(e)
    return f"({text})" if own < strength else text


def _with_strength(e: Expression) -> tuple[str, int]:
    if isinstance(e, Number):
        return number(e)
    if isinstance(e, Position):
        return _position(e.index)
    if isinstance(e, Read):
        return place(e.storage, e.full[len(e.storage.indices) :]), _ATOM
    name, arguments = e.operation, e.arguments
    if name in _INFIX and not (name == "rem" and e.type == "real"):
        sign, own = _INFIX[name]
        # `a - (b - c)` and `a / (b * c)`; compilers ask for parentheses round && in || and in comparisons.
        left, right = {"and": (own, own), "or": (_BOTH, _BOTH)}.get(name, (own, own + 1))
        if name in _COMPARED:
            left = right = _SUM
        return f"{expression(arguments[0], left)} {sign} {expression(arguments[1], right)}", own
    if name == "neg":
        return f"-{expression(arguments[0], _UNARY + 1)}", _UNARY
    if name == "not":
        return f"!{expression(arguments[0], _UNARY)}", _UNARY
    if name == "select":
        which, yes, no = (expression(a, _CHOICE + 1) for a in arguments)
        return f"{which} ? {yes} : {no}", _CHOICE
    if name == "is_finite":
        return f"isfinite({expression(arguments[0])}) != 0", 9
    if name in {"to_real", "to_int"}:
        return f"({'real' if name == 'to_real' else 'int'}){expression(arguments[0], _UNARY)}", _UNARY
    if name == "to_bool":
        return f"{expression(arguments[0], 10)} != {'0' if arguments[0].type == 'int' else 'R(0.0)'}", 9
    if name == "rsqrt":
        return f"R(1.0) / r_sqrt({expression(arguments[0])})", 12
    if name == "logistic":
        return f"R(1.0) / (R(1.0) + r_exp(-{expression(arguments[0], _UNARY + 1)}))", 12
    inner = ", ".join(expression(a) for a in arguments)
    if e.type == "int" and name == "sign":
        text = expression(arguments[0], _ATOM)
        return f"({text} > 0) - ({text} < 0)", 11
    if e.type == "int" and name in _LESSER:
        left, right = (expression(a, _SUM) for a in arguments)
        return f"{left} {_LESSER[name]} {right} ? {left} : {right}", _CHOICE
    return f"{called(FUNCTIONS.get(name, name))}({inner})", _ATOM


def called(function: str) -> str:
    """Return what a function of <math.h>, or a helper, is called in the source."""
    return function if function.startswith("wide_") else f"r_{short(function)}"


def short(function: str) -> str:
    """Return what a function of <math.h> is called behind ``r_``."""
    return "abs" if function == "fabs" else function


def number(n: Number) -> tuple[str, int]:
    """Return a constant's text and how tightly it binds."""
    value = n.value
    if n.type == "bool":
        return ("true" if value else "false"), _ATOM
    if n.type == "int":
        return str(int(value)), _ATOM if value >= 0 else _UNARY
    if math.isnan(value):
        return "(real)NAN", _UNARY
    if math.isinf(value):
        return ("(real)INFINITY" if value > 0 else "-(real)INFINITY"), _UNARY
    if value == _TINY:
        return "REAL_MIN", _ATOM
    if value == _EPSILON:
        return "REAL_EPSILON", _ATOM
    if abs(value) == sys.float_info.max:
        return ("REAL_MAX" if value > 0 else "-REAL_MAX"), _ATOM
    return f"R({decimal(value)})", _ATOM


def decimal(value: float) -> str:
    """Return a number that every reader takes for a floating-point one, exact to the last bit: 1.0e-03."""
    text = repr(float(value))
    mantissa, letter, exponent = text.partition("e")
    mantissa = mantissa if "." in mantissa else f"{mantissa}.0"
    if not letter:
        return mantissa
    sign = "-" if exponent.startswith("-") else "+"
    return f"{mantissa}e{sign}{int(exponent.lstrip('+-')):02d}"


def place(storage: Storage, indices: tuple[Index, ...]) -> str:
    """Return the text of a place."""
    return storage.name + "".join(f"[{_position(index)[0]}]" for index in (*storage.indices, *indices))


def _position(index: Index) -> tuple[str, int]:
    """Return the text of an index and how tightly it binds."""
    terms: list[tuple[str, int]] = []
    if index.variable is not None:
        terms.append((index.variable, _ATOM) if index.scale == 1 else (f"{index.scale} * {index.variable}", 12))
    if index.chosen is not None:
        terms.append(_with_strength(index.chosen))
    if not terms:
        return str(index.offset), _ATOM if index.offset >= 0 else _UNARY
    if len(terms) == 1 and not index.offset:
        return terms[0]
    text = " + ".join(f"({text})" if own < _SUM else text for text, own in terms)
    if index.offset:
        text = f"{text} {'+' if index.offset > 0 else '-'} {abs(index.offset)}"
    return text, _SUM


def statement(s: Assign, *, declare: bool) -> list[str]:
    """Return the lines of a statement.

    Args:
        s: the statement.
        declare: whether it declares its target, a number that is written once.
    """
    moved = _block_move(s)
    if moved is not None:
        return moved
    s = replace(s, value=fitted(s.value, is_wanted_wide=s.target.is_wide))
    target = place(s.target, s.indices)
    lines, depth = [], 0
    for variable, start, end in s.loops:
        lines.append(f"{'    ' * depth}for (int {variable} = {start}; {variable} < {end}; ++{variable}) {{")
        depth += 1
    pad = "    " * depth
    if s.inner:
        lines += _accumulation(s, target, pad, declare)
    else:
        typed = f"const {s.target.declared} " if declare else ""
        lines += wrapped(f"{pad}{typed}{_assignment(target, s.value)};")
    lines += ["    " * n + "}" for n in reversed(range(depth))]
    return lines


def _assignment(target: str, value: Expression) -> str:
    """Return an assignment, as a change of the target where it is one."""
    if isinstance(value, Apply) and value.operation in {"add", "sub"} and expression(value.arguments[0]) == target:
        sign, strength = _INFIX[value.operation]
        return f"{target} {sign}= {expression(value.arguments[1], strength + 1)}"
    return f"{target} = {expression(value)}"


_STARTS = {
    "sum": "R(0.0)", "product": "R(1.0)", "max": "-(real)INFINITY", "min": "(real)INFINITY", "and": "true",
    "or": "false", "place": "0",
}  # fmt: skip
"""What an accumulation begins with."""


def _accumulation(s: Assign, target: str, pad: str, declare: bool) -> list[str]:
    start = "0" if s.combine == "sum" and s.target.type == "int" else _STARTS[s.combine]
    typed = f"{s.target.declared} " if declare else ""
    lines, depth = [f"{pad}{typed}{target} = {start};"], 0
    for variable, first, end in s.inner:
        lines.append(f"{pad}{'    ' * depth}for (int {variable} = {first}; {variable} < {end}; ++{variable}) {{")
        depth += 1
    inner = pad + "    " * depth
    lines += wrapped(inner + _combined(s, target))
    return lines + [pad + "    " * n + "}" for n in reversed(range(depth))]


def _combined(s: Assign, target: str) -> str:
    if s.combine in {"sum", "product"}:
        return f"{target} {'+' if s.combine == 'sum' else '*'}= {expression(s.value)};"
    if s.combine in {"and", "or"}:
        sign, strength = _INFIX[s.combine]
        return f"{target} = {target} {sign} {expression(s.value, max(strength, _BOTH))};"
    if s.combine == "place":
        return f"{target} = {expression(s.value)};"
    return f"{target} = r_{s.combine}({target}, {expression(s.value)});"


def sums(body: Sequence[Assign], loop: Loop, declare: Sequence[bool]) -> list[str]:
    """Return the lines of sums that share a loop."""
    variable, start, end = loop
    targets = [place(s.target, s.indices) for s in body]
    lines = [f"{'real ' if new else ''}{target} = R(0.0);" for target, new in zip(targets, declare, strict=True)]
    lines.append(f"for (int {variable} = {start}; {variable} < {end}; ++{variable}) {{")
    for s, target in zip(body, targets, strict=True):
        lines += wrapped(f"    {target} += {expression(fitted(s.value, is_wanted_wide=s.target.is_wide))};")
    return [*lines, "}"]


def _block_move(s: Assign) -> list[str] | None:
    """Return a move of a whole block up its own array, which a loop from the front would overwrite."""
    if not isinstance(s.value, Read) or s.inner or not s.loops:
        return None
    same = s.value.storage.name == s.target.name and s.value.storage.indices == s.target.indices
    if not same or s.value.indices == s.indices:
        return None
    to, of = s.indices[0], s.value.indices[0]
    _, start, end = s.loops[0]
    first_to, first_of = (place(s.target, (Index(index.offset + start),)) for index in (to, of))
    return [f"memmove(&{first_to}, &{first_of}, {end - start} * sizeof {first_to});"]


def wrapped(line: str) -> list[str]:
    """Break a long line where it is least nested and binds least."""
    if len(line) <= WIDTH:
        return [line]
    pad = " " * (len(line) - len(line.lstrip()) + 4)
    lines, rest = [], line
    while len(rest) > WIDTH:
        cut = _best_cut(rest, len(pad) + 16)
        if cut is None:
            break
        lines.append(rest[:cut])
        rest = pad + rest[cut + 1 :]
    return [*lines, rest]


_BREAKS = {
    "=": 0,
    "?": 1,
    ":": 1,
    "||": 2,
    "&&": 2,
    "<=": 3,
    ">=": 3,
    "<": 3,
    ">": 3,
    "+": 4,
    "-": 4,
    "*": 5,
    "/": 5,
}


def _best_cut(line: str, least: int) -> int | None:
    depth, found = 0, []
    for place, letter in enumerate(line[:WIDTH]):
        depth += (letter in "([") - (letter in ")]")
        if letter == " " and place >= least:
            word = line[place + 1 :].split(" ", 1)[0]
            if word in _BREAKS and word != "=":
                found.append(((depth, _BREAKS[word]), -place))
            elif line[place - 1] == ",":
                found.append(((depth, 0), -place))
    return -min(found)[1] if found else None
