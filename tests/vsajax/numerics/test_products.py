import jax.numpy as jnp
import numpy as np
import pytest

from vsajax import numerics

pytestmark = pytest.mark.oracle

SIZE = 5
# Sums of five products of numbers below 3: a handful of roundings.
TOLERANCE = {"rtol": 1e-14, "atol": 1e-14}


@pytest.fixture(params=[SIZE, 1], ids=["five", "one"])
def problem(request):
    rng = np.random.default_rng(1)
    root = rng.normal(size=(request.param, request.param))
    return jnp.asarray(root @ root.T), jnp.asarray(rng.normal(size=request.param))


def test_symmetric_product_is_that_of_numpy(problem):
    matrix, vector = problem
    np.testing.assert_allclose(
        numerics.symmetric_product(matrix, vector), np.asarray(matrix) @ np.asarray(vector), **TOLERANCE
    )


def test_dot_is_that_of_numpy(problem):
    matrix, vector = problem
    expected = np.asarray(vector) @ np.asarray(matrix[0])
    np.testing.assert_allclose(numerics.dot(vector, matrix[0]), expected, **TOLERANCE)


def test_downdate_removes_a_weighted_outer_product(problem):
    matrix, vector = problem
    ours = numerics.rank_one_downdate(matrix, vector, jnp.asarray(0.3))
    np.testing.assert_allclose(
        ours, np.asarray(matrix) - 0.3 * np.outer(np.asarray(vector), np.asarray(vector)), **TOLERANCE
    )


def test_symmetric_part_is_scaled_and_exactly_symmetric(problem):
    matrix, vector = problem
    skewed = np.asarray(matrix) + np.outer(np.asarray(vector), np.arange(len(vector)))
    ours = np.asarray(numerics.scaled_symmetric_part(jnp.asarray(skewed), jnp.asarray(1.25)))
    np.testing.assert_allclose(ours, 1.25 * (skewed + skewed.T) / 2, **TOLERANCE)
    np.testing.assert_array_equal(ours, ours.T)


def test_trace_and_sum_of_squares_are_those_of_numpy(problem):
    matrix, _ = problem
    np.testing.assert_allclose(numerics.trace(matrix), np.trace(np.asarray(matrix)), **TOLERANCE)
    np.testing.assert_allclose(numerics.sum_of_squares(matrix), np.sum(np.asarray(matrix) ** 2), **TOLERANCE)


@pytest.mark.parametrize("function", [numerics.symmetric_product, lambda m, v: numerics.dot(m[0], v)])
def test_unequal_sizes_are_refused(function):
    # A TypeError where types are checked at run time.
    with pytest.raises((ValueError, TypeError)):
        function(jnp.eye(SIZE), jnp.ones(SIZE - 1))
