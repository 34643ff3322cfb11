"""Deflections of few counts are fitted too soft: the band knows by how much."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vsajax import Recording
from vsajax.estimators import Polynomial, RecursiveLeastSquares, SensorTorque, StiffnessEstimator
from vsajax.estimators.attenuation import resolved, start_resolution, variance_of
from vsajax.experiments import estimation

STIFFNESS, SAMPLES = 200.0, 20_000


def recording(counts: float, seed: int) -> Recording:
    """Return a deflection of some counts, at incommensurable rates, and its torque, all but exact."""
    time = np.arange(SAMPLES) * 1e-3
    rng = np.random.default_rng(seed)
    phases = rng.uniform(0.0, 2 * np.pi, 3)
    waves = [np.sin(2 * np.pi * f * time + p) for f, p in zip((0.37, 1.13, 2.71), phases, strict=True)]
    deflection = np.sum(waves, axis=0) / 100.0
    torque = STIFFNESS * deflection
    step = 0.03 / counts
    return Recording(
        jnp.asarray(time),
        deflection=jnp.asarray(step * np.round(deflection / step)),
        elastic_torque=jnp.asarray(torque + 1e-3 * rng.standard_normal(SAMPLES)),
    )


def run(counts: float, seed: int):
    estimator = StiffnessEstimator(
        SensorTorque(), Polynomial(0.02), RecursiveLeastSquares(1e9), deflection="measured"
    )
    return jax.jit(estimation.estimate)(estimator, recording(counts, seed))


@pytest.mark.analytic
@pytest.mark.parametrize("counts", [3.0, 6.0, 15.0])
def test_the_band_of_a_coarse_deflection_is_what_the_slope_loses(counts):
    # The classical attenuation of a slope: var(n)/(var(δ) + var(n)) of it, with var(n) = q²/12.
    answers = [run(counts, seed) for seed in range(16)]
    missing = STIFFNESS - np.asarray([answer.stiffness[-1] for answer in answers])
    stated = np.asarray([answer.stiffness_std[-1] for answer in answers])
    noise, moved = (0.03 / counts) ** 2 / 12.0, 1.5e-4
    expected = STIFFNESS * noise / (moved + noise)
    # An encoder's errors are no white noise: of three counts they follow the signal, and take a tenth more.
    assert abs(np.mean(missing) - expected) < max(0.15 * expected, 3.0 * np.std(missing) / 4.0)
    assert np.all(stated > 0.7 * expected)
    assert np.all(missing < 1.96 * stated)


@pytest.mark.statistical
def test_a_fine_encoder_widens_nothing():
    fine, exact = run(1e5, 0), run(1e9, 0)
    np.testing.assert_allclose(fine.stiffness_std[-1], exact.stiffness_std[-1], rtol=1e-3)


@pytest.mark.analytic
def test_the_step_is_the_smallest_change_so_far():
    state = start_resolution(jnp.asarray(2.0))
    assert variance_of((state,)) == 0.0
    for reading, step in ((2.0, np.inf), (2.5, 0.5), (4.0, 0.5), (3.75, 0.25), (3.75, 0.25), (0.0, 0.25)):
        state = resolved(state, jnp.asarray(reading))
        assert state.step == step
    assert variance_of((state, start_resolution(jnp.asarray(1.0)))) == pytest.approx(0.25**2 / 12.0)


@pytest.mark.contract
def test_a_signal_that_is_no_number_is_no_step():
    state = resolved(start_resolution(jnp.asarray(2.0)), jnp.asarray(jnp.nan))
    assert state.step == np.inf
