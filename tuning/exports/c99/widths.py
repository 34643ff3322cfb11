"""Where double precision stays in a single-precision build: running sums, and differences of them.

A sum over all samples outgrows single precision: `weight += 1` stops at 2^24, and the integral of a torque loses
what a millisecond adds to it after minutes. So sums stay `double` (`Storage.is_wide`), additions to them too, and
whatever else reads one rounds it first. In a double-precision build all of this is the same type.
"""

from __future__ import annotations

from tuning.exports.c99.expressions import Apply, Expression, Read, Type

_SUMS = frozenset({"add", "sub", "neg", "select"})
"""Operations of which the result is as wide as what they are given."""
_ARITHMETIC = _SUMS | {"mul", "div", "max", "min"}
"""Operations that C does, or a helper, in double precision where an operand is wide and a wide sum wants it."""
_COMPARISONS = frozenset({"lt", "le", "gt", "ge", "eq", "ne"})


def is_wide(e: Expression) -> bool:
    """Return whether an expression is a running sum, or a difference or choice of such."""
    if isinstance(e, Read):
        return e.storage.is_wide
    return isinstance(e, Apply) and e.type == "real" and e.operation in _SUMS and any(map(is_wide, e.arguments))


def fitted(e: Expression, *, is_wanted_wide: bool) -> Expression:
    """Return an expression with `to_real` wherever a wide number is handed on to what is not wide.

    Args:
        e: the expression.
        is_wanted_wide: whether it is added to a running sum, so that nothing may be rounded on the way.
    """
    if is_wanted_wide:
        return _kept(e)
    rounded = _inside(e)
    return _rounded(rounded) if is_wide(e) else rounded


def _inside(e: Expression) -> Expression:
    """Return an expression whose operands are rounded where its operation is not one on sums."""
    if not isinstance(e, Apply):
        return e
    if e.operation in _COMPARISONS or (e.type == "real" and e.operation in _SUMS):
        return Apply(e.operation, tuple(map(_inside, e.arguments)), e.type)
    return Apply(e.operation, tuple(fitted(a, is_wanted_wide=False) for a in e.arguments), e.type)


def _kept(e: Expression) -> Expression:
    """Return an expression in which arithmetic on wide numbers stays wide."""
    if not isinstance(e, Apply) or e.type != "real":
        return _inside(e)
    if e.operation in _ARITHMETIC:
        operation, arguments = e.operation, tuple(map(_kept, e.arguments))
        is_helped = operation in {"max", "min"} and any(map(_has_wide, arguments))
        return Apply(f"wide_{operation}" if is_helped else operation, arguments, e.type)
    return _inside(e)


def _has_wide(e: Expression) -> bool:
    if isinstance(e, Apply):
        is_arithmetic = e.operation in _ARITHMETIC or e.operation.startswith("wide_")
        return is_arithmetic and any(map(_has_wide, e.arguments))
    return is_wide(e)


def _rounded(e: Expression) -> Expression:
    kind: Type = "real"
    return Apply("to_real", (e,), kind)
