import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vsajax import Estimate, Scorer, Scores
from vsajax.experiments import estimation
from vsajax.rollout import sensitivity
from vsajax.types import Signals

pytestmark = pytest.mark.oracle

TIME = np.arange(501) * 0.01


def answer(stiffness, std=None, known=None) -> Estimate:
    """Return an estimate that says `stiffness`, with a given posterior and verdict."""
    stiffness = jnp.asarray(stiffness)
    zero = jnp.zeros_like(stiffness)
    std = zero if std is None else jnp.asarray(std)
    known = zero > 0.0 if known is None else jnp.asarray(known)
    return Estimate(stiffness, std, zero, known, Signals(zero, zero, zero, zero, zero))


def scored(truth, estimate: Estimate, time=TIME, **options) -> Scores:
    scores = estimation.score_estimate(jnp.asarray(time), jnp.asarray(truth), estimate, scorer=Scorer(**options))
    return jax.tree.map(float, scores)


@pytest.fixture
def curves():
    rng = np.random.default_rng(9)
    truth = 150.0 + 100.0 * np.sin(TIME)
    return truth, truth + rng.normal(scale=5.0, size=len(TIME))


def test_mse_and_msrep_are_the_printed_sums(curves):
    # (35)–(36): p + 1 terms over p. A sum of 501 terms of one sign rounds by 1e-14.
    truth, guess = curves
    scores, p = scored(truth, answer(guess)), len(TIME) - 1
    assert scores.mse == pytest.approx(np.sum((truth - guess) ** 2) / p, rel=1e-12)
    assert scores.msrep == pytest.approx(100.0 * np.sum(((truth - guess) / truth) ** 2) / p, rel=1e-12)


def test_settled_scores_count_from_the_warm_up_time_on(curves):
    truth, guess = curves
    late = TIME >= 1.5
    scores, p = scored(truth, answer(guess), warm_up=1.5), np.sum(late) - 1
    relative = (truth - guess)[late] / truth[late]
    assert scores.mse_settled == pytest.approx(np.sum((truth - guess)[late] ** 2) / p, rel=1e-12)
    assert scores.msrep_settled == pytest.approx(100.0 * np.sum(relative**2) / p, rel=1e-12)
    assert scores.max_relative_error == pytest.approx(np.max(np.abs(relative)), rel=1e-12)


def test_settled_scores_of_a_short_recording_are_not_numbers(curves):
    truth, guess = curves
    scores = scored(truth, answer(guess), warm_up=100.0)
    assert np.isnan([scores.mse_settled, scores.msrep_settled, scores.max_relative_error]).all()
    assert np.isfinite(scores.mse)


def test_convergence_time_is_the_last_time_outside_the_tolerance():
    truth = np.full(len(TIME), 100.0)
    guess = truth.copy()
    guess[:50], guess[120] = 0.0, 94.0
    assert scored(truth, answer(guess)).convergence_time == TIME[120]
    assert scored(truth, answer(guess), tolerance=0.07).convergence_time == TIME[49]
    assert scored(truth, answer(truth)).convergence_time == 0.0
    guess[-1] = 0.0
    assert scored(truth, answer(guess)).convergence_time == np.inf


def test_near_zero_stiffness_has_no_relative_error_and_is_counted(curves):
    truth, guess = curves[0].copy(), curves[1]
    truth[::5] = 0.5
    scores = scored(truth, answer(guess), stiffness_floor=1.0)
    counted = np.abs(truth) > 1.0
    relative = ((truth - guess) / truth)[counted]
    assert scores.near_zero_share == pytest.approx(np.mean(~counted), rel=1e-12)
    assert scores.msrep == pytest.approx(100.0 * np.sum(relative**2) / (np.sum(counted) - 1), rel=1e-12)
    late = counted & (TIME >= 2.0)
    relative = ((truth - guess) / truth)[late]
    assert scores.msrep_settled == pytest.approx(100.0 * np.sum(relative**2) / (np.sum(late) - 1), rel=1e-12)
    # The absolute error has no such exception.
    assert scores.mse == pytest.approx(np.sum((truth - guess) ** 2) / (len(TIME) - 1), rel=1e-12)


def test_true_zero_is_left_out_even_without_a_floor(curves):
    truth, guess = curves[0].copy(), curves[1]
    truth[10] = 0.0
    scores = scored(truth, answer(guess))
    assert np.isfinite(scores.msrep)
    assert scores.near_zero_share == pytest.approx(1 / len(TIME))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_diverged_estimate_is_flagged_and_never_converged(curves, bad):
    truth, guess = curves[0], curves[1].copy()
    assert scored(truth, answer(guess)).diverged == 0.0
    guess[-1] = bad
    scores = scored(truth, answer(guess))
    assert scores.diverged == 1.0
    assert scores.convergence_time == np.inf
    assert not np.isfinite(scores.mse)


def test_coverage_is_the_share_of_known_samples_within_the_band(curves):
    truth, guess = curves
    std, known = np.linspace(1.0, 6.0, len(TIME)), TIME > 2.0
    scores = scored(truth, answer(guess, std, known), sigmas=1.5)
    within = np.abs(truth - guess) <= 1.5 * std
    assert scores.coverage == pytest.approx(np.mean(within[known]), rel=1e-12)
    assert scores.known_share == pytest.approx(np.mean(known), rel=1e-12)
    assert scores.known_time == TIME[201]
    assert 0.3 < scores.coverage < 0.9


def test_never_known_has_no_coverage(curves):
    scores = scored(curves[0], answer(curves[1]))
    assert np.isnan(scores.coverage)
    assert scores.known_time == np.inf
    assert scores.known_share == 0.0


def test_default_band_holds_95_percent_of_a_normal():
    from scipy.stats import norm

    assert norm.cdf(float(Scorer().sigmas)) - norm.cdf(-float(Scorer().sigmas)) == pytest.approx(0.95, abs=1e-15)


@pytest.mark.equivalence
def test_residuals_square_to_the_msrep(golden):
    from tests.vsajax.builders import paper_basis, paper_estimator, paper_recording

    recording = paper_recording(golden, "sensor", 300)
    truth = jnp.asarray(golden["sigma"][:300]).at[7].set(0.0)
    estimator = paper_estimator(basis=paper_basis(2, 1))
    for settled in (False, True):
        scorer = Scorer(warm_up=0.1)
        observed = estimation.observe(recording, truth, scorer=scorer, settled=settled)
        loop = estimation.residual_loop(estimator, observed, scorer=scorer)
        residuals = sensitivity.run(loop)
        scores = estimation.score(estimator, recording, truth, scorer=scorer)
        expected = scores.msrep_settled if settled else scores.msrep
        np.testing.assert_allclose(jnp.sum(residuals**2), expected, rtol=1e-12)
        np.testing.assert_allclose(sensitivity.sum_of_squares(loop), expected, rtol=1e-12)
        assert residuals.shape == (300,)
