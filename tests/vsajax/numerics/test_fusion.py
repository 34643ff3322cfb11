"""`once` changes what the compiler does, never a value, a derivative or what is shared between lanes."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vsajax.numerics import once


def shared(x, y):
    """Two values of which only the first depends on x."""
    return once((jnp.sin(x) * y, 3.0 * y))


@pytest.mark.gradient
@pytest.mark.parametrize("differentiate", [jax.grad, jax.jacfwd, jax.jacrev])
def test_derivatives_pass_through(differentiate):
    found = differentiate(lambda x: once(jnp.sin(x)) * once(x))(0.7)
    np.testing.assert_allclose(found, np.cos(0.7) * 0.7 + np.sin(0.7), rtol=1e-15)


@pytest.mark.structure
def test_what_is_not_batched_stays_so():
    first, second = jax.vmap(shared, in_axes=(0, None), out_axes=(0, None))(jnp.arange(3.0), 2.0)
    np.testing.assert_allclose(first, 2.0 * np.sin(np.arange(3.0)), rtol=1e-15)
    assert second == 6.0
    program = jax.make_jaxpr(jax.vmap(shared, in_axes=(0, None)))(jnp.arange(3.0), 2.0)
    (barrier,) = (equation for equation in program.eqns if equation.primitive.name == "optimization_barrier")
    assert [variable.aval.shape for variable in barrier.outvars] == [(3,), ()]
