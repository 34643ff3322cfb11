"""Looking into traced and compiled programs."""

from __future__ import annotations

from collections.abc import Iterator

import jax
from jax.extend.core import ClosedJaxpr, Jaxpr, JaxprEqn


def equations(program: Jaxpr | ClosedJaxpr) -> Iterator[JaxprEqn]:
    """Yield every equation of a program, also those of its inner programs."""
    for equation in open_program(program).eqns:
        yield equation
        for inner in jax.tree.leaves(list(equation.params.values()), is_leaf=is_program):
            if is_program(inner):
                yield from equations(inner)


def scans(program: Jaxpr | ClosedJaxpr) -> list[JaxprEqn]:
    """Return every scan of a program."""
    return [equation for equation in equations(program) if equation.primitive.name == "scan"]


def held_shapes(scan: JaxprEqn) -> list[tuple[int, ...]]:
    """Return the shapes of what a scan carries or closes over; its inputs lose their leading axis inside."""
    inside = open_program(scan.params["jaxpr"]).invars
    pairs = [(outer.aval.shape, inner.aval.shape) for outer, inner in zip(scan.invars, inside, strict=True)]
    return [inner for outer, inner in pairs if outer == inner]


def is_program(value: object) -> bool:
    """Return whether an equation's parameter is a program."""
    return isinstance(value, (Jaxpr, ClosedJaxpr))


def open_program(program: Jaxpr | ClosedJaxpr) -> Jaxpr:
    """Return a program without its constants."""
    return program.jaxpr if isinstance(program, ClosedJaxpr) else program
