"""Least squares along a loop: JᵀJ and Jᵀr accumulated as it runs, in memory that does not grow with its length.

Forward sensitivities run beside the state. Which of its leaves the parameters move at all is found out first, so
that what they do not move, such as a covariance that follows from the features alone, has no sensitivity to carry.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Float, PyTree

from vsajax.rollout.loops import divisor_near, scan
from vsajax.types import Scalar

_SEGMENT = 64


class Loop(NamedTuple):
    """What `scan` runs to give residuals, as one pytree, so that any part of it can depend on parameters.

    Args:
        step: (state, input) -> (state, residual); a module, or a method of one, where it depends on any.
        state: the first state.
        inputs: with a leading time axis.
    """

    step: Callable[[Any, Any], tuple[Any, Scalar]]
    state: Any
    inputs: PyTree


def run(loop: Loop) -> Float[Array, " time"]:
    """Return the residuals."""
    return scan(loop.step, loop.state, loop.inputs)[1]


def sum_of_squares(loop: Loop) -> Scalar:
    """Return the sum of the squared residuals, accumulated as the loop runs."""

    def advance(carry: tuple[Any, Scalar], sample: Any) -> tuple[tuple[Any, Scalar], None]:
        state, total = carry
        state, residual = loop.step(state, sample)
        return (state, total + residual * residual), None

    return scan(advance, (loop.state, jnp.zeros(())), loop.inputs)[0][1]


def normal_equations(loop_at: Callable[[Float[Array, " p"]], Loop], at: Float[Array, " p"]) -> Float[Array, "q q"]:
    """Return MᵀM of M = [J r], the residuals r and their derivatives J = ∂r/∂parameters; q = p + 1.

    Args:
        loop_at: the loop as a pure function of the parameters.
        at: the parameters.
    """
    loop = loop_at(at)
    moved = _settle(loop, _moved(loop_at, at))

    def along(direction: Float[Array, " p"]) -> Loop:
        return jax.jvp(lambda x: eqx.filter(loop_at(x), moved), (at,), (direction,))[1]

    sensitivity = jax.vmap(along)(jnp.eye(at.size, dtype=at.dtype))

    def advance(carry: tuple[Any, Any, Array], sample: tuple[Any, Any]) -> tuple[tuple[Any, Any, Array], None]:
        state, of_state, total = carry
        inputs, of_inputs = sample
        moving, fixed = eqx.partition(Loop(loop.step, state, inputs), moved)

        def step(moving: Loop) -> tuple[tuple[Any, Scalar], Any]:
            now = eqx.combine(moving, fixed)
            state, residual = now.step(now.state, now.inputs)
            return (eqx.filter(state, moved.state), residual), state

        def step_along(direction: Loop) -> tuple[tuple[Any, Scalar], tuple[Any, Scalar], Any]:
            return jax.jvp(step, (moving,), (direction,), has_aux=True)

        directions = Loop(sensitivity.step, of_state, of_inputs)
        along_all = jax.vmap(step_along, out_axes=(None, 0, None), axis_size=at.size)
        (_, residual), (of_state, slopes), state = along_all(directions)
        row = jnp.concatenate([slopes, residual[None]])
        return (state, of_state, total + row[:, None] * row), None

    start = (loop.state, sensitivity.state, jnp.zeros((at.size + 1, at.size + 1), at.dtype))
    inputs = (loop.inputs, jax.tree.map(lambda x: jnp.moveaxis(x, 0, 1), sensitivity.inputs))
    # Nothing is differentiated in reverse: segments need not grow with the number of samples.
    segment = divisor_near(jax.tree.leaves(loop.inputs)[0].shape[0], _SEGMENT)
    return scan(advance, start, inputs, segment=segment)[0][2]


def _settle(loop: Loop, moved: Loop) -> Loop:
    """Return which leaves move, once what moves at first has moved all of the state that follows from it."""
    one = loop._replace(inputs=jax.tree.map(lambda x: x[0], loop.inputs))
    moving, fixed = eqx.partition(one, moved)

    def next_state(moving: Loop) -> Any:
        now = eqx.combine(moving, fixed)
        return now.step(now.state, now.inputs)[0]

    state = jax.tree.map(lambda before, after: before or after, moved.state, _moved(next_state, moving))
    return moved if state == moved.state else _settle(loop, moved._replace(state=state))


def _moved[Tree](function: Callable[[Any], Tree], at: PyTree) -> Tree:
    """Return which leaves of a function's value depend on its argument, as booleans; no number is computed."""
    found: Any = None

    @jax.custom_jvp
    def probe(values: Tree) -> Tree:
        return values

    @partial(probe.defjvp, symbolic_zeros=True)
    def _(primals: tuple[Tree], tangents: tuple[Tree]) -> tuple[Tree, Tree]:
        nonlocal found
        found = jax.tree.map(lambda x: not isinstance(x, SymbolicZero), tangents[0])
        return primals[0], primals[0]

    everything: Any = None

    def probed(at: PyTree) -> Tree:
        nonlocal everything
        values = function(at)
        everything = jax.tree.map(lambda _: False, values)
        return probe(eqx.filter(values, eqx.is_inexact_array))

    jax.eval_shape(lambda x: jax.jvp(probed, (x,), (x,)), at)
    return eqx.combine(found, everything)
