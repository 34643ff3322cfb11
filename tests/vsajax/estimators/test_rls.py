import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.oracles import least_squares
from tests.oracles.basis import separable
from tests.vsajax.builders import PITCH, quantise
from tests.vsajax.estimators.parts import LAWS, regression, run_fit
from vsajax import estimators
from vsajax.estimators import (
    ConstantFactor,
    EnhancedFactor,
    ExponentialForgetting,
    RecursiveLeastSquares,
)

PRIOR = 50.0


def assert_close(ours, theirs, relative):
    np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=relative * np.max(np.abs(theirs)))


@pytest.fixture(params=["well-scaled", "AwAS"])
def problem(request, golden):
    """Features, targets and the directions in which estimates are compared."""
    if request.param == "well-scaled":
        features, targets = regression()
        return features, targets, np.eye(features.shape[1])
    setpoint = 1000.0 * (0.1 + PITCH * quantise(golden["theta_c"], 1024))
    features, slopes = separable(golden["phi_hat"], setpoint)
    # High powers of a few milliradians leave their coefficients free; what they add up to is well defined.
    return features, golden["torque_residual"], slopes[::100].T


@pytest.mark.contract
def test_registry_holds_every_gain_law():
    classes = {cls for _, cls in inspect.getmembers(estimators, inspect.isclass)}
    laws = {cls for cls in classes if issubclass(cls, estimators.AbstractGainLaw)}
    assert {type(law) for law in LAWS.values()} == laws - {estimators.AbstractGainLaw}


@pytest.mark.contract
@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS.keys())
def test_covariance_stays_symmetric_and_positive(law):
    features, targets = regression()
    state, _, _ = run_fit(RecursiveLeastSquares(PRIOR, law), features, targets)
    covariance = np.asarray(state.covariance)
    # What rounding makes asymmetric while P is of the size of the prior stays, but must not grow.
    np.testing.assert_allclose(covariance, covariance.T, rtol=0.0, atol=8 * PRIOR * np.finfo(float).eps)
    assert np.all(np.linalg.eigvalsh(covariance) > 0.0)


@pytest.mark.contract
@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS.keys())
def test_samples_without_features_teach_nothing(law):
    state, coefficients, _ = run_fit(RecursiveLeastSquares(PRIOR, law), np.zeros((20, 3)), np.ones(20))
    np.testing.assert_array_equal(coefficients, 0.0)
    # Nor does forgetting inflate it beyond the prior, but while another coefficient has its turn.
    near = 0.05 if isinstance(law, ExponentialForgetting) else 1e-13
    np.testing.assert_allclose(np.asarray(state.covariance), PRIOR * np.eye(3), rtol=near)


@pytest.mark.oracle
def test_plain_recursion_matches_the_printed_one(problem):
    features, targets, directions = problem
    state, coefficients, factors = run_fit(RecursiveLeastSquares(1.0), features, targets)
    theirs, covariance = least_squares.plain(features, targets, 1.0)
    assert_close(coefficients @ directions, theirs @ directions, 1e-10)
    assert_close(np.asarray(state.covariance), covariance, 1e-10)
    np.testing.assert_array_equal(factors, 1.0)


@pytest.mark.oracle
def test_enhanced_recursion_matches_the_printed_one(problem):
    features, targets, directions = problem
    fit = RecursiveLeastSquares(1e20, EnhancedFactor(1e-20))
    _, coefficients, factors = run_fit(fit, features, targets)
    theirs, their_factors = least_squares.enhanced(features, targets, 1e20, 1e-20)
    assert_close(coefficients @ directions, theirs @ directions, 1e-10)
    np.testing.assert_allclose(factors, their_factors, rtol=1e-10)


@pytest.mark.oracle
def test_constant_factor_matches_the_printed_recursion(problem):
    features, targets, directions = problem
    _, coefficients, factors = run_fit(RecursiveLeastSquares(1.0, ConstantFactor(0.3)), features, targets)
    theirs, their_factors = least_squares.with_factor(features, targets, 1.0, lambda rho: 0.3)
    assert_close(coefficients @ directions, theirs @ directions, 1e-10)
    np.testing.assert_allclose(factors, their_factors, rtol=1e-15)


@pytest.mark.oracle
@pytest.mark.parametrize("memory", [1.0, 0.99, 0.9])
def test_forgetting_recursion_is_that_of_the_information(memory):
    features, targets = regression()
    fit = RecursiveLeastSquares(PRIOR, ExponentialForgetting(memory))
    state, coefficients, _ = run_fit(fit, features, targets)
    theirs, covariance, _ = least_squares.forgetting(features, targets, PRIOR, memory)
    assert_close(coefficients, theirs, 1e-10)
    assert_close(np.asarray(state.covariance), covariance, 1e-10)


@pytest.mark.oracle
@pytest.mark.parametrize("memory", [0.99, 0.9])
def test_forgetting_stays_accurate_over_many_memories(memory):
    # Asymmetry of P that is inflated by 1/λ a sample would have grown by 1e43 (λ = 0.99) over these samples.
    features, targets = regression(samples=10_000)
    priors = [1.0, PRIOR]
    solutions = [least_squares.forgetting(features, targets, prior, memory)[0][-1] for prior in priors]

    @jax.vmap
    def last_coefficients(prior):
        return run_fit(RecursiveLeastSquares(prior, ExponentialForgetting(memory)), features, targets)[1][-1]

    # λ = 0.9 remembers ten samples for four coefficients: a condition number of up to 1e3.
    np.testing.assert_allclose(last_coefficients(jnp.asarray(priors)), solutions, rtol=1e-12)
    np.testing.assert_allclose(last_coefficients(jnp.asarray(priors[:1])), solutions[:1], rtol=1e-12)


@pytest.mark.analytic
@pytest.mark.parametrize("memory", [0.99, 0.9])
def test_what_is_never_excited_grows_to_the_prior_while_the_rest_is_forgotten(memory):
    # One coefficient is excited and changes half way; the others stay as they are, and hinder nothing.
    features = np.zeros((2000, 4))
    features[:, 0] = 1.0
    targets = np.repeat([2.0, 3.0], 1000)
    state, coefficients, _ = run_fit(
        RecursiveLeastSquares(PRIOR, ExponentialForgetting(memory)), features, targets
    )
    assert coefficients[999, 0] == pytest.approx(2.0, rel=1e-2 / PRIOR)
    # Of the old value, λ a sample is left, as long as the prior's own share is small beside it.
    left = memory ** np.arange(1.0, 1001.0)
    near = left > 0.1
    np.testing.assert_allclose(3.0 - coefficients[1000:, 0][near], left[near], rtol=0.03)
    np.testing.assert_array_equal(coefficients[:, 1:], 0.0)
    variances = np.diag(np.asarray(state.covariance))
    # The excited one weighs 1/(1 − λ) samples; the others lie within one round of turns of the prior.
    assert variances[0] == pytest.approx(1.0 - memory, rel=0.01)
    ripple = 4.0 * (1.0 - memory) / (1.0 - memory**4)
    assert np.all((variances[1:] >= PRIOR / ripple * 0.99) & (variances[1:] <= PRIOR / (ripple * memory**4)))


@pytest.mark.equivalence
def test_forgetting_nothing_is_the_plain_recursion(problem):
    features, targets, directions = problem
    _, plain, _ = run_fit(RecursiveLeastSquares(1.0), features, targets)
    _, forgetting, _ = run_fit(RecursiveLeastSquares(1.0, ExponentialForgetting(1.0)), features, targets)
    # The same operations and a multiplication by one; compilers may fuse them differently.
    assert_close(forgetting @ directions, plain @ directions, 1e-13)


@pytest.mark.oracle
@pytest.mark.parametrize("prior", [1e-2, 1.0, 1e6])
def test_estimate_is_ridge_regression(prior):
    features, targets = regression()
    _, coefficients, _ = run_fit(RecursiveLeastSquares(prior), features, targets)
    # Well conditioned; but P, which falls from the prior to 1/300, keeps the rounding of its first steps.
    solution, _ = least_squares.ridge(features, targets, prior)
    np.testing.assert_allclose(coefficients[-1], solution, rtol=max(1e-13, 300 * prior * np.finfo(float).eps))


@pytest.mark.oracle
def test_every_intermediate_estimate_is_the_ridge_regression_so_far():
    features, targets = regression(samples=40)
    _, coefficients, _ = run_fit(RecursiveLeastSquares(PRIOR), features, targets)
    for k in (0, 1, 2, 3, 5, 10, 39):
        solution, _ = least_squares.ridge(features[: k + 1], targets[: k + 1], PRIOR)
        assert_close(coefficients[k], solution, 1e-11)


@pytest.mark.oracle
def test_forgetting_under_a_wide_prior_is_weighted_least_squares():
    features, targets = regression()
    _, coefficients, _ = run_fit(RecursiveLeastSquares(1e8, ExponentialForgetting(0.97)), features, targets)
    weights = 0.97 ** np.arange(len(targets) - 1, -1, -1.0)
    solution, _ = least_squares.ridge(features, targets, 1e30, weights)
    assert_close(coefficients[-1], solution, 1e-6)


@pytest.mark.analytic
def test_enhanced_factor_runs_from_its_constant_to_one():
    law = EnhancedFactor(1e-3)
    leverages = jnp.asarray([0.0, 1.0, 1e3, 1e12])
    factors = np.asarray([law(leverage).factor for leverage in leverages])
    np.testing.assert_allclose(factors, (1e-3 + 1e-3 * leverages) / (1.0 + 1e-3 * leverages), rtol=1e-15)
    assert factors[0] == 1e-3
    assert 1.0 - factors[-1] < 1e-8
