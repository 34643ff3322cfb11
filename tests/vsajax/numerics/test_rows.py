import jax.numpy as jnp
import numpy as np
import pytest

from vsajax import numerics

pytestmark = pytest.mark.oracle

SIZE = 5
# Sums of five products of numbers below 3: a handful of roundings.
TOLERANCE = {"rtol": 1e-14, "atol": 1e-14}


@pytest.fixture
def problem():
    rng = np.random.default_rng(1)
    root = rng.normal(size=(SIZE, SIZE))
    return root @ root.T, rng.normal(size=SIZE)


def rows(matrix):
    return tuple(jnp.asarray(row) for row in matrix)


def scalars(vector):
    return tuple(jnp.asarray(entry) for entry in vector)


def test_combination_of_rows_is_the_matrix_vector_product(problem):
    matrix, vector = problem
    np.testing.assert_allclose(numerics.combine_rows(rows(matrix), scalars(vector)), matrix @ vector, **TOLERANCE)


def test_dot_matches_numpy(problem):
    matrix, vector = problem
    np.testing.assert_allclose(numerics.dot(scalars(vector), scalars(matrix[0])), vector @ matrix[0], **TOLERANCE)


def test_downdate_removes_a_weighted_outer_product(problem):
    matrix, vector = problem
    ours = numerics.rank_one_downdate(rows(matrix), jnp.asarray(vector), jnp.asarray(0.3))
    np.testing.assert_allclose(np.stack(ours), matrix - 0.3 * np.outer(vector, vector), **TOLERANCE)


def test_symmetric_part_is_scaled_and_exactly_symmetric(problem):
    matrix, vector = problem
    skewed = matrix + np.outer(vector, np.arange(SIZE))
    ours = np.stack(numerics.scaled_symmetric_part(rows(skewed), jnp.asarray(1.25)))
    np.testing.assert_allclose(ours, 1.25 * (skewed + skewed.T) / 2, **TOLERANCE)
    np.testing.assert_array_equal(ours, ours.T)


def test_scaled_identity_is_diagonal():
    np.testing.assert_array_equal(np.stack(numerics.scaled_identity(jnp.asarray(7.0), 4)), 7.0 * np.eye(4))


def test_combination_refuses_unequal_lengths(problem):
    matrix, vector = problem
    with pytest.raises(ValueError, match="zip"):
        numerics.combine_rows(rows(matrix), scalars(vector[:-1]))
