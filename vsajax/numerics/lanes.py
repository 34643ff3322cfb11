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
    def run(size: int, is_batched: list[bool], *arguments: Array) -> tuple[Result, PyTree]:
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
_lanes_minor.def_impl(lambda x: x)
_lanes_minor.def_abstract_eval(lambda x: x)
mlir.register_lowering(_lanes_minor, lambda context, x: [x])
ad.deflinear2(_lanes_minor, lambda cotangent, x: [_lanes_minor.bind(cotangent)])


def _batch_lanes_minor(values: tuple[Lanes], axes: tuple[int]) -> tuple[Lanes, int]:
    (x,), (lane,) = values, axes
    others = [axis for axis in range(x.ndim) if axis != lane]
    return with_layout_constraint(x, Layout((*others, lane))), lane


batching.primitive_batchers[_lanes_minor] = _batch_lanes_minor


def lanes_minor(x: Lanes) -> Lanes:
    """Return `x` as it is; under `vmap` neighbouring lanes are neighbours in memory.

    Derivatives pass through. Of nested `vmap`s the innermost that batches `x` counts.
    """
    return _lanes_minor.bind(x)


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
