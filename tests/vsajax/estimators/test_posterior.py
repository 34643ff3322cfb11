"""What `RecursiveLeastSquares.variance` says: s² · directionᵀ (XᵀX + I/κ)⁻¹ direction."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import signal

from tests.oracles import least_squares
from tests.vsajax.estimators.parts import LAWS, regression, run_fit
from vsajax import rollout
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


def averages(steps, blend):
    """Running averages m of the innovations, and the variances v that they have of white ones: sums, not steps."""
    weights = blend * (1.0 - blend) ** np.arange(len(steps))
    return np.convolve(weights, steps)[: len(steps)], np.cumsum(weights**2)


@pytest.mark.oracle
def test_squares_of_independent_innovations_add_up_to_the_ridge_objective():
    # Σ ε²/(1+ρ) is the minimum of Σ (y − Fᵀη)² + ηᵀη/κ: that knows no recursion.
    features, targets = regression()
    state, _, _ = run_fit(RecursiveLeastSquares(PRIOR), features, targets)
    _, minimum = least_squares.ridge(features, targets, PRIOR)
    np.testing.assert_allclose(state.squares, minimum, rtol=RELATIVE)
    np.testing.assert_array_equal([state.freedom, state.weight], len(targets))


@pytest.mark.oracle
@pytest.mark.parametrize("blend", [1.0, 0.3, 0.02])
def test_variance_is_the_documented_one(blend):
    features, targets = regression()
    fit = RecursiveLeastSquares(PRIOR)
    state, _, _ = run_fit(fit, features, targets, blend)
    means, variances = averages(least_squares.forgetting(features, targets, PRIOR, 1.0)[2], blend)
    freedom = np.sum(variances) * (1.0 - 4 / len(targets)) - 1.0
    spread = DIRECTION @ np.linalg.solve(features.T @ features + np.eye(4) / PRIOR, DIRECTION)
    assert variance(fit, state) == pytest.approx(np.sum(means**2) / freedom * spread, rel=RELATIVE)


@pytest.mark.oracle
@pytest.mark.parametrize(("memory", "blend", "kept"), [(0.98, 1.0, 0.98), (0.9, 1.0, 0.975), (0.9, 0.2, 0.995)])
def test_forgetting_variance_is_that_of_the_weighted_regression(memory, blend, kept):
    # The noise is remembered for longer than the coefficients where their memory is less than twenty averages.
    features, targets = regression()
    fit = RecursiveLeastSquares(PRIOR, ExponentialForgetting(memory))
    state, _, _ = run_fit(fit, features, targets, blend)
    _, covariance, steps = least_squares.forgetting(features, targets, PRIOR, memory)
    means, variances = averages(steps, blend)
    remembered = kept ** np.arange(len(means) - 1, -1, -1.0)
    squares, freedom = np.sum(remembered * means**2), np.sum(remembered * variances)
    counted = np.sum(memory ** np.arange(len(targets)))
    noise = squares / (freedom * (1.0 - 4 / counted) - 1.0)
    assert variance(fit, state) == pytest.approx(noise * DIRECTION @ covariance @ DIRECTION, rel=1e-9)


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


@pytest.mark.statistical
@pytest.mark.parametrize("time_constant", [5.0, 40.0])
def test_the_band_of_a_mean_in_correlated_noise_is_the_one_that_repetitions_have(time_constant):
    # A regression on the constant 1 in noise through a first-order lag, averaged over ten of its time constants.
    rng = np.random.default_rng(8)
    decay, samples, draws = np.exp(-1.0 / time_constant), 8000, 300
    white = rng.normal(size=(draws, samples + 400))
    noise = signal.lfilter([1.0 - decay], [1.0, -decay], white)[:, 400:]
    fit, blend = RecursiveLeastSquares(1e3), 1.0 / (1.0 + 10.0 * time_constant)

    @jax.jit
    @jax.vmap
    def mean_of(targets):
        state, _, _ = run_fit(fit, jnp.ones((samples, 1)), targets, blend)
        return state.coefficients[0], fit.variance(state, jnp.ones(1))

    found, variances = map(np.asarray, mean_of(jnp.asarray(noise)))
    # An average over ten time constants hears 10/11 of the slow part. A variance of 300 draws errs by √(2/300),
    # the stated ones by less.
    freedom = samples * blend / (2.0 - blend)
    expected = 10.0 / 11.0 * freedom / (freedom - 1.0)
    assert abs(np.mean(variances) / np.var(found) / expected - 1.0) < 4 * np.sqrt(2 / draws)


@pytest.mark.analytic
def test_innovations_that_cancel_make_a_narrow_band():
    # The mean of an alternating sequence is known far better than that of white noise of its size.
    targets = np.where(np.arange(1000) % 2, 1.0, -1.0)
    fit = RecursiveLeastSquares(1e3)
    independent, averaged = (run_fit(fit, np.ones((1000, 1)), targets, blend)[0] for blend in (1.0, 0.1))
    assert variance(fit, independent, [1.0]) == pytest.approx(1e-3, rel=0.01)
    assert variance(fit, averaged, [1.0]) < 0.1e-3


@pytest.mark.analytic
@pytest.mark.parametrize("law", [UnitFactor(), EnhancedFactor(1e-3), ExponentialForgetting(0.99)])
def test_variance_is_infinite_until_there_are_more_samples_than_coefficients(law):
    features, targets = regression(samples=8)
    fit = RecursiveLeastSquares(PRIOR, law)
    for samples in (1, 4, 5):
        assert variance(fit, run_fit(fit, features[:samples], targets[:samples])[0]) == np.inf
    assert np.isfinite(variance(RecursiveLeastSquares(PRIOR), run_fit(fit, features, targets)[0]))


@pytest.mark.analytic
def test_what_was_never_measured_is_not_certain():
    # A dead torque sensor: every target is 0, and so is every innovation.
    features, _ = regression()
    fit = RecursiveLeastSquares(PRIOR)
    assert variance(fit, run_fit(fit, features, np.zeros(300))[0]) == np.inf


@pytest.mark.analytic
@pytest.mark.parametrize("forgetting", [0.9, 0.99, 0.999, 0.99999])
@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_an_hour_at_rest_leaves_numbers_and_a_second_of_motion_recovers(forgetting, noise):
    rng = np.random.default_rng(9)
    truth, rest, across = np.array([2.0, -1.0]), np.array([1.0, 0.5]), np.array([-0.5, 1.0])
    fit = RecursiveLeastSquares(1e4, ExponentialForgetting(forgetting))

    def moved(samples):
        features = rng.normal(size=(samples, 2))
        return features, features @ truth + 0.1 * rng.normal(size=samples)

    @jax.jit
    def run(state, features, targets):
        def step(state, row):
            state, _ = fit.step(state, *row, blend=0.05)
            return state, fit.variance(state, jnp.asarray(across))

        return rollout.scan(step, state, (features, targets))

    state, before = run(fit.init(2), *map(jnp.asarray, moved(2000)))
    # 3,600 s at 1 kHz: the same readings, or noise around them.
    hour = 3_600_000
    still = np.tile(rest, (hour, 1))
    state, resting = run(state, jnp.asarray(still), jnp.asarray(still @ truth + noise * rng.normal(size=hour)))
    assert np.all(np.isfinite(np.asarray(state.covariance)))
    assert np.all(np.isfinite(np.asarray(state.coefficients)))
    assert np.all(np.asarray(resting) > 0.0)
    # Rest says nothing of what it does not excite, and readings that stay the same say nothing of the noise.
    assert np.min(resting) >= 0.5 * before[-1]
    state, after = run(state, *map(jnp.asarray, moved(1000)))
    error = abs(float(across @ (state.coefficients - truth)))
    assert error < 5.0 * np.sqrt(float(after[-1]))
    assert error < (0.5 if forgetting < 0.95 else 0.1)


@pytest.mark.analytic
def test_constant_factor_has_no_posterior():
    assert np.isnan(LAWS["constant"].posterior_scale())
    features, targets = regression()
    fit = RecursiveLeastSquares(PRIOR, ConstantFactor(0.4))
    assert np.isnan(variance(fit, run_fit(fit, features, targets)[0]))
