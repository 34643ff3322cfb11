import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vsajax.numerics.sums import sum_of_products

# Sums of five products of numbers below 3, in another order.
TOLERANCE = {"rtol": 1e-13, "atol": 1e-13}
LANES = 4


def plain(left, right):
    return jnp.sum(left * right, axis=0)


def numbers(seed, *shape):
    return jnp.asarray(np.random.default_rng(seed).normal(size=shape))


@pytest.mark.equivalence
@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("shapes", [((5,), (5,)), ((5, 1), (5, 3)), ((1, 2), (1, 2))])
@pytest.mark.parametrize("lanes", [None, (0, 0), (0, None), (None, 0), (1, 0), (0, 1)])
def test_values_and_derivatives_are_those_of_a_sum(shapes, lanes, compiled):
    def of(function):
        def every(left, right):
            _, tangent = jax.jvp(function, (left, right), (jnp.cos(left), jnp.sin(right)))
            return (
                tangent,
                jax.grad(lambda pair: jnp.sum(function(*pair) ** 3))((left, right)),
                function(left, right),
            )

        batched = every if lanes is None else jax.vmap(every, in_axes=lanes)
        return jax.jit(batched) if compiled else batched

    def given(seed, shape, lane):
        return numbers(seed, *shape) if lane is None else numbers(seed, *shape[:lane], LANES, *shape[lane:])

    first, second = lanes or (None, None)
    arguments = given(1, shapes[0], first), given(2, shapes[1], second)
    ours, expected = of(sum_of_products)(*arguments), of(plain)(*arguments)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, **TOLERANCE), ours, expected)


@pytest.mark.structure
def test_under_every_vmap_it_is_one_operation():
    nested = jax.vmap(jax.vmap(sum_of_products, in_axes=(None, 0)), in_axes=(0, None))
    program = jax.make_jaxpr(nested)(jnp.ones((2, 18)), jnp.ones((3, 18)))
    names = [equation.primitive.name for equation in program.eqns]
    assert names.count("sum_of_products") == 1
    assert "add" not in names


@pytest.mark.oracle
def test_terms_are_added_in_their_order():
    left, right = jnp.asarray([1.0, 1e16, -1e16]), jnp.ones(3)
    assert float(jax.jit(sum_of_products)(left, right)) == 0.0
    assert float(jax.jit(sum_of_products)(left[::-1], right)) == 1.0
