"""The enhanced RLS (25)–(27) is ordinary RLS: c and P(0) are one prior scale κ = c·P(0)."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.oracles.basis import separable
from tests.vsajax.builders import PITCH, SAMPLE_TIME, quantise
from tests.vsajax.estimators.parts import run_fit
from vsajax import plants
from vsajax.estimators import EnhancedFactor, RecursiveLeastSquares
from vsajax.plants import Torques, awas

pytestmark = pytest.mark.equivalence

SAMPLES = 10_001


@pytest.fixture(scope="module")
def experiment():
    """Features, slopes and a noisy torque of ten seconds of the AwAS, as its encoders see them."""
    time = np.arange(SAMPLES) * SAMPLE_TIME
    wave = np.sin(0.2 * np.pi * time)
    torques = Torques(jnp.asarray(0.3 * wave), jnp.asarray(8.0 * wave), jnp.zeros(SAMPLES))
    motion = jax.jit(lambda u: plants.simulate(awas(), u, jnp.asarray(SAMPLE_TIME), substeps=1))(torques)
    deflection = quantise(np.asarray(motion.link_position), 40000) - quantise(
        np.asarray(motion.motor_position), 40000
    )
    arm = 1000.0 * (0.1 + PITCH * quantise(np.asarray(motion.setpoint_position), 1024))
    features, slopes = separable(deflection, arm)
    noise = np.random.default_rng(4).normal(scale=0.03, size=SAMPLES)
    return features, slopes, np.asarray(motion.elastic_torque) + noise


def stiffness(fit, experiment):
    features, slopes, targets = experiment
    state, coefficients, factors = run_fit(fit, features, targets)
    return np.sum(np.asarray(coefficients) * slopes, axis=1), np.asarray(state.covariance), np.asarray(factors)


@pytest.mark.parametrize("prior_scale", [1.0, 1e-2, 1e2])
def test_enhanced_recursion_is_the_plain_one(experiment, prior_scale):
    plain, covariance, _ = stiffness(RecursiveLeastSquares(prior_scale), experiment)
    printed = RecursiveLeastSquares(1e20, EnhancedFactor(1e-20 * prior_scale))
    enhanced, scaled_covariance, factors = stiffness(printed, experiment)
    # Exact in exact arithmetic; 10,001 steps of rounding leave 4e-15 (κ = 1) and 7e-15 (κ = 100).
    np.testing.assert_allclose(enhanced, plain, rtol=0.0, atol=1e-12 * np.max(np.abs(plain)))
    full = prior_scale * 1e-12
    np.testing.assert_allclose(1e-20 * prior_scale * scaled_covariance, covariance, rtol=0.0, atol=full)
    # It is not the trivial identity a = 1: the factor spans many decades on the way.
    assert factors.min() < 1e-15 * prior_scale
    assert factors.max() > 1e-5 * prior_scale


def test_only_the_product_of_constant_and_covariance_matters(experiment):
    one, _, _ = stiffness(RecursiveLeastSquares(1e20, EnhancedFactor(1e-18)), experiment)
    other, _, _ = stiffness(RecursiveLeastSquares(1e9, EnhancedFactor(1e-7)), experiment)
    np.testing.assert_allclose(other, one, rtol=0.0, atol=1e-12 * np.max(np.abs(one)))
    different, _, _ = stiffness(RecursiveLeastSquares(1e20, EnhancedFactor(1e-20)), experiment)
    assert np.max(np.abs(different - one)) > 1e-2 * np.max(np.abs(one))


def test_gains_and_estimates_follow_from_the_covariance_alone(experiment):
    # η̂(k) = P(k) b(k) with b = Σ F y: shared gains make every further torque signal two dot products a sample.
    features, _, targets = experiment
    state, coefficients, _ = run_fit(RecursiveLeastSquares(1.0), features, targets)
    from_covariance = np.asarray(state.covariance) @ (features.T @ targets)
    slopes = experiment[1][-1]
    # Theory page: 1e-12 relative at κ = 1 (measured), from cancellation in P·b.
    np.testing.assert_allclose(slopes @ from_covariance, slopes @ np.asarray(coefficients[-1]), rtol=1e-10)
