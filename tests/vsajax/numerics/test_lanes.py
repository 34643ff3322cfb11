import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import export

from vsajax.numerics import lanes_minor

TABLE = jnp.asarray(np.random.default_rng(0).normal(size=(4, 6, 3)))


def decay(row):
    """Carry a vector of an odd length through a loop."""

    def step(state, _):
        return lanes_minor(0.5 * state + jnp.cos(state)), None

    return jax.lax.scan(step, lanes_minor(row), None, length=5)[0]


def plain(row):
    for _ in range(5):
        row = 0.5 * row + jnp.cos(row)
    return row


@pytest.mark.contract
@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("depth", [0, 1, 2])
def test_values_and_derivatives_are_those_without(depth, compiled):
    def of(function):
        def both(x):
            _, tangent = jax.jvp(function, (x,), (jnp.ones_like(x),))
            return function(x), tangent, jax.grad(lambda y: jnp.sum(function(y) ** 2))(x)

        for _ in range(depth):
            both = jax.vmap(both)
        return (jax.jit(both) if compiled else both)(TABLE[(0,) * (2 - depth)])

    for ours, expected in zip(of(decay), of(plain), strict=True):
        np.testing.assert_allclose(ours, expected, rtol=1e-14, atol=1e-14)


@pytest.mark.contract
def test_lanes_are_neighbours_in_the_memory_of_what_a_loop_carries():
    program = jax.jit(jax.vmap(decay)).lower(jnp.ones((64, 3))).compile().as_text()
    carried = re.findall(r"f64\[64,3\]\{([\d,]+)\}", re.search(r"= \((.*)\) while", program).group(1))
    assert set(carried) == {"0,1"}


@pytest.mark.contract
def test_what_is_not_batched_stays_so():
    outer = jax.vmap(lambda x, shared: lanes_minor(shared) + x, in_axes=(0, None))
    program = jax.make_jaxpr(outer)(jnp.ones(4), jnp.ones(3))
    (equation,) = (one for one in program.eqns if one.primitive.name == "lanes_minor")
    assert equation.outvars[0].aval.shape == (3,)


@pytest.mark.contract
def test_a_batched_program_orders_memory_and_its_export_does_not():
    lanes = jnp.ones((64, 3))
    program = jax.jit(jax.vmap(decay))
    assert "LayoutConstraint" in program.lower(lanes).as_text()
    written = export.export(program, platforms=("cpu", "cuda"))(lanes).serialize()
    np.testing.assert_array_equal(export.deserialize(written).call(lanes), program(lanes))
