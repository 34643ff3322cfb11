"""What rounding may do to recursive least squares: a limit for every processor, and where there is none."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tuning.papers.antagonistic.rows import worst_errors
from vsajax import rollout
from vsajax.estimators import RecursiveLeastSquares


def _regression(spread: float, samples: int = 400) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return features whose sizes differ by `spread`, exact targets, and the coefficients behind them."""
    features = np.random.default_rng(7).normal(size=(samples, 3)) * [1.0, spread**-0.5, 1.0 / spread]
    coefficients = np.array([1.0, -2.0, 60.0])
    return features, features @ coefficients, coefficients


def _recursive(features: np.ndarray, targets: np.ndarray, prior: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the coefficients after every sample, and the least diagonal element that P ever has."""
    fit = RecursiveLeastSquares(prior)

    def step(state, row):
        state, _ = fit.step(state, *row)
        return state, (state.coefficients, jnp.min(jnp.diagonal(state.covariance)))

    rows = (jnp.asarray(features), jnp.asarray(targets))
    found, least = jax.jit(lambda rows: rollout.scan(step, fit.init(3), rows)[1])(rows)
    return np.asarray(found), np.asarray(least)


@pytest.mark.analytic
@pytest.mark.parametrize("spread", [1.0, 1e2, 1e4])
def test_rounding_and_prior_stay_within_their_limit(spread):
    features, targets, coefficients = _regression(spread)
    prior = 1e11
    found, least = _recursive(features, targets, prior)
    slopes = features / np.linalg.norm(features, axis=1, keepdims=True)
    off = np.abs(np.sum(slopes * (found - coefficients), axis=1))
    limit = worst_errors(features, coefficients, slopes, prior)
    assert np.all(off[10:] <= limit[10:])
    assert np.all(least > 0.0)
    # Not a limit that anything would meet.
    assert np.all(limit[100:] < 1e-5 * np.linalg.norm(coefficients))


@pytest.mark.failure
def test_a_prior_that_leaves_no_digits_has_no_limit():
    features, targets, coefficients = _regression(1e2)
    with pytest.raises(ValueError, match="leaves no digit"):
        worst_errors(features, coefficients, features, 1e20)
    # Which is no caution: P does not stay positive definite.
    assert np.min(_recursive(features, targets, 1e20)[1]) <= 0.0
