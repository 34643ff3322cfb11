"""Evaluating a step in plain IEEE arithmetic, as C does.

XLA's CPU backend contracts a product and a sum into a fused multiply-add where the processor has one, and rounds
once where C rounds twice. Both are right; what they differ by is what rounding alone does to an estimate. A golden
recording must not depend on the processor that made it, so its products are kept apart from its sums.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
from jax.extend import core as jex

from tuning.exports.flatten import CALLED


def uncontracted[**P, Result](function: Callable[P, Result]) -> Callable[P, Result]:
    """Return the function with every product rounded before anything is added to it."""

    def run(*arguments: P.args, **options: P.kwargs) -> Result:
        closed, shape = jax.make_jaxpr(function, return_shape=True)(*arguments, **options)
        leaves = jax.tree.leaves((arguments, options))
        results = _evaluate(closed.jaxpr, closed.consts, leaves)
        return jax.tree.unflatten(jax.tree.structure(shape), results)

    return run


def _evaluate(jaxpr: Any, consts: Any, arguments: Any) -> list[Any]:
    known: dict[Any, Any] = dict(zip(jaxpr.invars, arguments, strict=True))
    known |= dict(zip(jaxpr.constvars, consts, strict=True))

    def read(atom: Any) -> Any:
        return atom.val if isinstance(atom, jex.Literal) else known[atom]

    for eqn in jaxpr.eqns:
        given = [read(atom) for atom in eqn.invars]
        inner = next((eqn.params[name] for name in CALLED if hasattr(eqn.params.get(name), "jaxpr")), None)
        if eqn.primitive.name == "scan":
            results = _scanned(eqn, given)
        elif inner is not None:
            results = _evaluate(inner.jaxpr, inner.consts, given)
        else:
            outcome = eqn.primitive.bind(*given, **eqn.params)
            results = outcome if eqn.primitive.multiple_results else [outcome]
        if eqn.primitive.name in {"mul", "square", "integer_pow"}:
            results = jax.lax.optimization_barrier(list(results))
        known.update(zip(eqn.outvars, results, strict=True))
    return [read(atom) for atom in jaxpr.outvars]


def _scanned(eqn: Any, given: list[Any]) -> list[Any]:
    """Run a scan, every turn of it in plain arithmetic."""
    consts, carried, rows = map(list, eqn.params["ft_in"].update(given).unpack())
    body = eqn.params["jaxpr"]

    def turn(now: list[Any], row: list[Any]) -> tuple[list[Any], list[Any]]:
        results = _evaluate(body.jaxpr, body.consts, [*consts, *now, *row])
        return results[: len(carried)], results[len(carried) :]

    length, is_reversed = eqn.params["length"], eqn.params["reverse"]
    last, collected = jax.lax.scan(turn, carried, rows, length=length, reverse=is_reversed)
    return [*last, *collected]
