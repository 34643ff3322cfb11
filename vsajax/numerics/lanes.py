"""Small arrays whose lanes come last.

`vmap` puts lanes in front: an array of 7 × 7 numbers a lane is then worked on 7 numbers at a time, and XLA's CPU
backend does not vectorise over lanes. With lanes last every operation is elementwise over contiguous lanes, and a
program of array operations compiles in seconds where one of scalars takes a minute.

`lanes_last` hands a function its arrays so. `lanes_minor` leaves the axes alone and orders the memory so, which is
all that the state of a loop allows: `scan` puts the lanes of what it carries in front.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

import jax
import jax.numpy as jnp
from jax.experimental.layout import Layout, with_layout_constraint
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array, Float, PyTree

Lanes = Float[Array, "..."]


def lanes_last[Result: PyTree](function: Callable[..., Result]) -> Callable[..., Result]:
    """Return `function` so that `vmap` hands it its arrays with the lanes as their last axis.

    Args:
        function: of arrays, to arrays; every operation must take any number of further axes at the end.

    Returns:
        A function of the same results. Its derivative is that of `function`; only `vmap` differs.
    """
    batched = jax.custom_batching.custom_vmap(function)

    @batched.def_vmap
    def run(size: Any, is_batched: list[bool], *arguments: Array) -> tuple[Result, PyTree]:
        # `size` is an int, or the name of any number of lanes in a program that is exported.
        pairs = zip(arguments, is_batched, strict=True)
        last = [
            jnp.moveaxis(x, 0, -1) if own else jnp.broadcast_to(x[..., None], (*x.shape, size)) for x, own in pairs
        ]
        results = jax.tree.map(lambda y: jnp.moveaxis(y, -1, 0), function(*last))
        return results, jax.tree.map(lambda _: True, results)

    @wraps(function)
    def call(*arguments: Array) -> Result:
        return batched(*arguments)

    return call


_lanes_minor = Primitive("lanes_minor")
"""Its `order` names the axes in memory, the last one neighbours; `None` until it is batched."""


@_lanes_minor.def_impl
def _ordered(x: Lanes, *, order: tuple[int, ...] | None) -> Lanes:
    return x if order is None else with_layout_constraint(x, Layout(order))


def _lower(context: mlir.LoweringRuleContext, x: Any, *, order: tuple[int, ...] | None) -> Any:
    # An order is a matter of speed on one machine, and no operation that jax keeps readable for other versions.
    if order is None or context.module_context.lowering_parameters.for_export:
        return [x]
    return mlir.lower_fun(_ordered, multiple_results=False)(context, x, order=order)


def _batch(values: tuple[Lanes], axes: tuple[int], *, order: tuple[int, ...] | None) -> tuple[Lanes, int]:
    (x,), (lane,) = values, axes
    if order is None:
        moved = (*(axis for axis in range(x.ndim) if axis != lane), lane)
    else:
        moved = (lane, *(axis + (axis >= lane) for axis in order))
    return _lanes_minor.bind(x, order=moved), lane


_lanes_minor.def_abstract_eval(lambda x, **_: x)
ad.deflinear2(_lanes_minor, lambda cotangent, x, *, order: [_lanes_minor.bind(cotangent, order=order)])
batching.primitive_batchers[_lanes_minor] = _batch
mlir.register_lowering(_lanes_minor, _lower)


def lanes_minor(x: Lanes) -> Lanes:
    """Return `x` as it is; under `vmap` neighbouring lanes are neighbours in memory.

    Derivatives pass through. Of nested `vmap`s the innermost that batches `x` counts. What `jax.export` writes has
    no order: whoever compiles it chooses.
    """
    return _lanes_minor.bind(x, order=None)


def identity_like(matrix: Lanes) -> Lanes:
    """Return the identity with as many axes at the end, each of length 1, as `matrix` has lanes' axes."""
    size = matrix.shape[0]
    return jnp.eye(size, dtype=matrix.dtype).reshape(size, size, *[1] * (matrix.ndim - 2))


def apply(matrix: Lanes, vector: Lanes) -> Lanes:
    """Return M v; lanes are last."""
    return (matrix * vector[None]).sum(1)


def apply_transposed(matrix: Lanes, vector: Lanes) -> Lanes:
    """Return Mᵀ v; lanes are last."""
    return (matrix * vector[:, None]).sum(0)
