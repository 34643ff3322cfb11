"""What `RecursiveLeastSquares.variance` says: s² · f · directionᵀ (XᵀX + I/κ)⁻¹ direction."""

import jax.numpy as jnp
import numpy as np
import pytest

from tests.oracles import least_squares
from tests.vsajax.estimators.parts import LAWS, regression, run_fit
from vsajax.estimators import (
    ConstantFactor,
    EnhancedFactor,
    ExponentialForgetting,
    RecursiveLeastSquares,
    UnitFactor,
)

PRIOR = 50.0
DIRECTION = np.array([1.0, -2.0, 0.5, 3.0])
# Well-conditioned regressions of a few hundred samples: rounding stays near 1e-14.
RELATIVE = 1e-11


def variance(fit, state, direction=DIRECTION):
    return float(fit.variance(state, jnp.asarray(direction)))


def innovations(features, targets, prior, memory=1.0):
    """Normalised innovations ε/√(1 + ρ) in information form, with ρ = FᵀPF before each sample."""
    information, right, answers = np.eye(features.shape[1]) / prior, np.zeros(features.shape[1]), []
    for k, (row, target) in enumerate(zip(features, targets, strict=True)):
        past = memory if k else 1.0
        information, right = past * information, past * right
        leverage = row @ np.linalg.solve(information, row)
        answers.append((target - row @ np.linalg.solve(information, right)) / np.sqrt(1.0 + leverage))
        information, right = information + np.outer(row, row), right + target * row
    return np.array(answers)


@pytest.mark.oracle
@pytest.mark.parametrize("memory", [1.0, 0.97])
def test_squares_add_up_to_the_ridge_objective(memory):
    # Σ λ^(N−k) ε²/(1+ρ) is the minimum of Σ λ^(N−k)(y − Fᵀη)² + λ^(N−1) ηᵀη/κ: that knows no recursion.
    features, targets = regression()
    fit = RecursiveLeastSquares(PRIOR, ExponentialForgetting(memory))
    state, _, _ = run_fit(fit, features, targets)
    weights = memory ** np.arange(len(targets) - 1, -1, -1.0)
    _, minimum = least_squares.ridge(features, targets, PRIOR / memory ** (len(targets) - 1), weights)
    np.testing.assert_allclose(state.squares, minimum, rtol=RELATIVE)
    np.testing.assert_allclose(state.weight, np.sum(weights), rtol=RELATIVE)


@pytest.mark.oracle
def test_variance_is_the_documented_one():
    features, targets = regression()
    fit = RecursiveLeastSquares(PRIOR)
    state, _, _ = run_fit(fit, features, targets)
    _, minimum = least_squares.ridge(features, targets, PRIOR)
    steps = innovations(features, targets, PRIOR)
    correlation = np.clip(np.sum(steps[1:] * steps[:-1]) / np.sum(steps**2), 0.0, 0.999)
    noise = minimum / (len(targets) - features.shape[1])
    spread = DIRECTION @ np.linalg.solve(features.T @ features + np.eye(4) / PRIOR, DIRECTION)
    expected = noise * spread * (1 + correlation) / (1 - correlation)
    assert variance(fit, state) == pytest.approx(expected, rel=RELATIVE)


@pytest.mark.oracle
def test_forgetting_variance_is_that_of_the_weighted_regression():
    memory = 0.97
    features, targets = regression()
    fit = RecursiveLeastSquares(PRIOR, ExponentialForgetting(memory))
    state, _, _ = run_fit(fit, features, targets)
    age = np.arange(len(targets) - 1, -1, -1.0)
    weights = memory**age
    steps = innovations(features, targets, PRIOR, memory)
    squares, products = np.sum(weights * steps**2), np.sum(weights[1:] * steps[1:] * steps[:-1])
    correlation = np.clip(products / squares, 0.0, 0.999)
    noise = squares / (np.sum(weights) - 4)
    information = features.T @ (weights[:, None] * features) + memory ** (len(targets) - 1) * np.eye(4) / PRIOR
    spread = DIRECTION @ np.linalg.solve(information, DIRECTION)
    expected = noise * spread * (1 + correlation) / (1 - correlation)
    assert variance(fit, state) == pytest.approx(expected, rel=RELATIVE)


@pytest.mark.oracle
@pytest.mark.parametrize("prior", [1e-3, 1e-2, PRIOR])
def test_determined_coefficients_are_the_trace_of_the_hat_matrix(prior):
    features, targets = regression()
    hat = features @ np.linalg.solve(features.T @ features + np.eye(4) / prior, features.T)
    for fit in (RecursiveLeastSquares(prior), RecursiveLeastSquares(prior * 1e6, EnhancedFactor(1e-6))):
        determined = fit.determined(run_fit(fit, features, targets)[0])
        assert determined == pytest.approx(np.trace(hat), rel=RELATIVE)


@pytest.mark.equivalence
def test_printed_enhanced_form_has_the_variance_of_the_plain_one():
    features, targets = regression()
    plain, printed = RecursiveLeastSquares(PRIOR), RecursiveLeastSquares(PRIOR * 1e12, EnhancedFactor(1e-12))
    variances = [variance(fit, run_fit(fit, features, targets)[0]) for fit in (plain, printed)]
    assert variances[0] == pytest.approx(variances[1], rel=RELATIVE)


@pytest.mark.analytic
def test_correlated_innovations_widen_the_band():
    # A regression on the constant 1 whose noise is a two-sample average: innovations correlate by one half.
    rng = np.random.default_rng(8)
    noise = rng.normal(size=20_001)
    targets = 5.0 + noise[1:] + noise[:-1]
    fit = RecursiveLeastSquares(1e3)
    state, _, _ = run_fit(fit, np.ones((20_000, 1)), targets)
    white = float(state.squares) / 20_000 / 20_000
    # r = ½ ± 1/√20000: f = (1 + r)/(1 − r) = 3 ± 8·0.007, at four sigma.
    assert variance(fit, state, [1.0]) / white == pytest.approx(3.0, abs=4 * 8 * 0.007)


@pytest.mark.analytic
def test_alternating_innovations_do_not_narrow_the_band():
    targets = np.where(np.arange(1000) % 2, 1.0, -1.0)
    fit = RecursiveLeastSquares(1e3)
    state, _, _ = run_fit(fit, np.ones((1000, 1)), targets)
    # r = −1 is clipped to 0: the variance is s²/N, with a ridge of 1e-3 samples.
    assert variance(fit, state, [1.0]) == pytest.approx(float(state.squares) / 999 / 1000, rel=1e-5)


@pytest.mark.analytic
@pytest.mark.parametrize("law", [UnitFactor(), EnhancedFactor(1e-3), ExponentialForgetting(0.99)])
def test_variance_is_infinite_until_there_are_more_samples_than_coefficients(law):
    features, targets = regression(samples=5)
    fit = RecursiveLeastSquares(PRIOR, law)
    for samples in (1, 4):
        assert variance(fit, run_fit(fit, features[:samples], targets[:samples])[0]) == np.inf
    assert np.isfinite(variance(RecursiveLeastSquares(PRIOR), run_fit(fit, features, targets)[0]))


@pytest.mark.analytic
def test_constant_factor_has_no_posterior():
    assert np.isnan(LAWS["constant"].posterior_scale())
    features, targets = regression()
    fit = RecursiveLeastSquares(PRIOR, ConstantFactor(0.4))
    assert np.isnan(variance(fit, run_fit(fit, features, targets)[0]))
