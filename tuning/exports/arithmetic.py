"""Evaluating a step in plain IEEE arithmetic, as C does.

XLA's CPU backend contracts a product and a sum into a fused multiply-add where the processor has one, and rounds
once where C rounds twice. Both are right; what they differ by is what rounding alone does to an estimate. A golden
recording must not depend on the processor that made it, so its products are kept apart from its sums.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.extend import core as jex

from tuning.exports.flatten import CALLED

_PRODUCTS = frozenset({"mul", "square", "integer_pow"})


def uncontracted[**P, Result](function: Callable[P, Result], zero: jax.Array) -> Callable[P, Result]:
    """Return the function with every product rounded before anything is added to it.

    Args:
        function: of arrays.
        zero: a whole 0 that the compiler does not know, an argument of what it compiles: each product's bits are
            combined with it, and what comes out may be anything as far as the compiler can tell.
    """

    def run(*arguments: P.args, **options: P.kwargs) -> Result:
        closed, shape = jax.make_jaxpr(function, return_shape=True)(*arguments, **options)
        leaves = jax.tree.leaves((arguments, options))
        results = _evaluate(closed.jaxpr, closed.consts, leaves, zero)
        return jax.tree.unflatten(jax.tree.structure(shape), results)

    return run


def _evaluate(jaxpr: Any, consts: Any, arguments: Any, zero: jax.Array) -> list[Any]:
    known: dict[Any, Any] = dict(zip(jaxpr.invars, arguments, strict=True))
    known |= dict(zip(jaxpr.constvars, consts, strict=True))

    def read(atom: Any) -> Any:
        return atom.val if isinstance(atom, jex.Literal) else known[atom]

    for eqn in jaxpr.eqns:
        given = [read(atom) for atom in eqn.invars]
        inner = next((eqn.params[name] for name in CALLED if hasattr(eqn.params.get(name), "jaxpr")), None)
        if eqn.primitive.name == "scan":
            results = _scanned(eqn, given, zero)
        elif inner is not None:
            results = _evaluate(inner.jaxpr, inner.consts, given, zero)
        elif eqn.primitive.name == "dot_general":
            results = [_contracted(given, eqn.params["dimension_numbers"], zero)]
        else:
            outcome = eqn.primitive.bind(*given, **eqn.params)
            results = outcome if eqn.primitive.multiple_results else [outcome]
        if eqn.primitive.name in _PRODUCTS:
            results = [_rounded(one, zero) for one in results]
        known.update(zip(eqn.outvars, results, strict=True))
    return [read(atom) for atom in jaxpr.outvars]


def _rounded(product: jax.Array, zero: jax.Array) -> jax.Array:
    """Return a product as it is, by a way that no compiler can see through."""
    if not jnp.issubdtype(product.dtype, jnp.floating):
        return product
    whole = jnp.dtype(f"int{8 * product.dtype.itemsize}")
    bits = jax.lax.bitcast_convert_type(product, whole) ^ zero.astype(whole)
    return jax.lax.bitcast_convert_type(bits, product.dtype)


def _scanned(eqn: Any, given: list[Any], zero: jax.Array) -> list[Any]:
    """Run a scan, every turn of it in plain arithmetic."""
    consts, carried, rows = map(list, eqn.params["ft_in"].update(given).unpack())
    body = eqn.params["jaxpr"]

    def turn(now: list[Any], row: list[Any]) -> tuple[list[Any], list[Any]]:
        results = _evaluate(body.jaxpr, body.consts, [*consts, *now, *row], zero)
        return results[: len(carried)], results[len(carried) :]

    length, is_reversed = eqn.params["length"], eqn.params["reverse"]
    last, collected = jax.lax.scan(turn, carried, rows, length=length, reverse=is_reversed)
    return [*last, *collected]


def _contracted(given: list[Any], numbers: Any, zero: jax.Array) -> jax.Array:
    """Return a product of arrays as the sum of products that it is."""
    (left_axes, right_axes), (left_batch, right_batch) = numbers
    left, right = (jnp.asarray(one) for one in given)
    left = _ordered(left, left_batch, left_axes)
    right = _ordered(right, right_batch, right_axes)
    shared, summed = len(left_batch), len(left_axes)
    middle = left.ndim - shared - summed
    left = left.reshape(
        left.shape[: shared + middle] + (1,) * (right.ndim - shared - summed) + left.shape[shared + middle :]
    )
    right = right.reshape(right.shape[:shared] + (1,) * middle + right.shape[shared:])
    products = _rounded(left * right, zero)
    return products.sum(tuple(range(products.ndim - summed, products.ndim)))


def _ordered(array: jax.Array, batch: Any, axes: Any) -> jax.Array:
    """Return an array with the axes that are summed over last, those of the batch first."""
    rest = [axis for axis in range(array.ndim) if axis not in {*batch, *axes}]
    return array.transpose(*batch, *rest, *axes)
