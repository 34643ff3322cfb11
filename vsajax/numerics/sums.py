"""Sums of products over a short axis, term after term.

XLA's CPU backend makes a loop of a reduction and does not vectorise it over lanes; of a chain of additions it
makes one expression, elementwise over them. Written as such a chain in Python, a sum of 18 products is 53
operations to trace, and again under every `vmap`. Here it is one, which becomes the chain when it is lowered.
"""

from __future__ import annotations

import functools
from typing import Any

import jax
import jax.numpy as jnp
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array, Float

Terms = Float[Array, "terms ..."]


def sum_of_products(left: Terms, right: Terms) -> Float[Array, "..."]:
    """Return Σᵢ leftᵢ · rightᵢ over the first axis, in its order.

    Args:
        left: terms; of as many axes as `right`, the further ones of the same length or of length 1.
        right: terms.
    """
    return _sum_of_products.bind(left, right, axis=0)


def _chain(left: Array, right: Array, *, axis: int) -> Array:
    terms = zip(jnp.unstack(left, axis=axis), jnp.unstack(right, axis=axis), strict=True)
    return functools.reduce(lambda total, term: total + term, [one * other for one, other in terms])


def _shape(left: Any, right: Any, *, axis: int) -> Any:
    shape = jnp.broadcast_shapes(left.shape, right.shape)
    return left.update(shape=(*shape[:axis], *shape[axis + 1 :]))


def _transpose_left(cotangent: Any, left: Any, right: Any, *, axis: int) -> Array:
    return _reduced(jnp.expand_dims(cotangent, axis) * right, left.aval.shape)


def _transpose_right(cotangent: Any, left: Any, right: Any, *, axis: int) -> Array:
    return _reduced(jnp.expand_dims(cotangent, axis) * left, right.aval.shape)


def _reduced(product: Array, shape: tuple[int, ...]) -> Array:
    """Return the sum of `product` over what was broadcast from `shape`; broadcast what it lacks."""
    axes = [axis for axis, (n, own) in enumerate(zip(product.shape, shape, strict=True)) if own == 1 != n]
    return jnp.broadcast_to(product.sum(axes, keepdims=True), shape)


def _batch(values: tuple[Array, Array], lanes: tuple[int | None, int | None], *, axis: int) -> tuple[Array, int]:
    lane = next(one for one in lanes if one is not None)
    left, right = (
        jnp.expand_dims(value, lane) if own is None else jnp.moveaxis(value, own, lane)
        for value, own in zip(values, lanes, strict=True)
    )
    axis += lane <= axis
    return _sum_of_products.bind(left, right, axis=axis), lane - (axis < lane)


_sum_of_products = Primitive("sum_of_products")
_sum_of_products.def_impl(jax.jit(_chain, static_argnames="axis"))
_sum_of_products.def_abstract_eval(_shape)
ad.defbilinear(_sum_of_products, _transpose_left, _transpose_right)
batching.primitive_batchers[_sum_of_products] = _batch
mlir.register_lowering(_sum_of_products, mlir.lower_fun(_chain, multiple_results=False))
