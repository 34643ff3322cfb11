"""The C that says whether parameters lie where they may: `NAME_check`, and `NAME_refusal` in words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from tuning.exports.c99.expressions import Index
from tuning.exports.c99.generate import storage_of
from tuning.exports.c99.lowering import loops_over
from tuning.exports.c99.printing import decimal, place
from tuning.exports.layout import Leaf, Path, dotted
from tuning.exports.program import StepProgram
from tuning.exports.ranges import Order, Range


def check_lines(program: StepProgram) -> list[str]:
    """Return the body of `NAME_check`: every parameter in its order, then the orders among them.

    A number that is not one fails every comparison, so conditions say what must hold.
    """
    leaves = dict(program.parameters.places)
    lines: list[str] = []
    places = zip(program.parameters.places, program.limits.ranges, strict=True)
    for number, ((path, leaf), limits) in enumerate(places, 1):
        if leaf.kind != "bool":
            lines += _refused_unless(_within(path, leaf, limits), leaf.shape, number)
    for number, order in enumerate(program.limits.orders, len(leaves) + 1):
        leaf = leaves[order.lower]
        sign = "<" if order.is_strict else "<="
        condition = f"{_place(order.lower, leaf)} {sign} {_place(order.upper, leaf)}"
        lines += _refused_unless(condition, leaf.shape, number)
    return [*lines, "return 0;"]


def refusals(program: StepProgram) -> Iterator[str]:
    """Yield what is wrong by the number that `NAME_check` returns, the first for 0."""
    yield "every parameter lies in its range"
    for name, limits in zip(program.parameters.names, program.limits.ranges, strict=True):
        yield f"{name}: must be {_ascii(limits.text)}{_finite(limits)}"
    for order in program.limits.orders:
        yield f"{dotted(order.lower)}: {_ascii(told_order(order))}"


def _finite(limits: Range) -> str:
    return " and finite" if (limits.low is None) != (limits.high is None) else ""


def told_order(order: Order) -> str:
    """Return an order for people."""
    return f"must be {'below' if order.is_strict else 'at most'} {dotted(order.upper)}"


def _ascii(text: str) -> str:
    return text.replace("≤", "<=")


def _within(path: Path, leaf: Leaf, limits: Range) -> str:
    here = _place(path, leaf)
    whole = leaf.kind == "int"
    low = None if limits.low is None else f"R({decimal(limits.low)})"
    high = None if limits.high is None else f"R({decimal(limits.high)})"
    conditions = []
    if low is not None:
        conditions.append(f"{here} {'>' if limits.is_low_open else '>='} {low}")
    elif not whole:
        conditions.append(f"{here} >= -REAL_MAX")
    if high is not None:
        conditions.append(f"{here} {'<' if limits.is_high_open else '<='} {high}")
    elif not whole:
        conditions.append(f"{here} <= REAL_MAX")
    return " && ".join(conditions)


def _place(path: Path, leaf: Leaf) -> str:
    indices: tuple[Index, ...] = loops_over(leaf.shape)[0]
    return place(storage_of(path, leaf, "params", "given"), indices).replace("params.", "params->", 1)


def _refused_unless(condition: str, shape: Sequence[int], number: int) -> list[str]:
    if not condition:
        return []
    loops = loops_over(shape)[1]
    pads = ["    " * depth for depth in range(len(loops) + 1)]
    heads = [
        f"{pad}for (int {variable} = {start}; {variable} < {end}; ++{variable}) {{"
        for pad, (variable, start, end) in zip(pads, loops, strict=False)
    ]
    body = [f"if (!({condition})) {{", f"    return {number};", "}"]
    return [*heads, *(pads[-1] + line for line in body), *(f"{pad}}}" for pad in reversed(pads[:-1]))]
