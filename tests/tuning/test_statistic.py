"""Means, quantiles and tails of scores, and their weights."""

from __future__ import annotations

import numpy as np
import pytest

from tuning.study.statistic import Statistic

SCORES = np.random.default_rng(0).exponential(size=(3, 37))


@pytest.mark.oracle
@pytest.mark.parametrize("level", [0.5, 0.9, 0.95])
def test_quantile_is_numpys(level):
    found = Statistic(kind="quantile", level=level).of(SCORES)
    np.testing.assert_allclose(found, np.quantile(SCORES, level, axis=1), rtol=1e-13)


@pytest.mark.analytic
def test_tail_is_the_mean_of_the_worst():
    # 10 % of 40 are four; 10 % of 37 are 3.7: the fourth counts by 0.7.
    ordered = np.sort(SCORES, axis=1)
    np.testing.assert_allclose(
        Statistic(kind="cvar", level=0.9).of(SCORES), (ordered[:, -3:].sum(axis=1) + 0.7 * ordered[:, -4]) / 3.7
    )
    forty = np.arange(40.0)
    assert Statistic(kind="cvar", level=0.9).of(forty) == pytest.approx(37.5)
    np.testing.assert_allclose(Statistic().of(SCORES), SCORES.mean(axis=1))


@pytest.mark.parametrize("kind", ["mean", "quantile", "cvar"])
@pytest.mark.parametrize("count", [1, 2, 7, 64])
def test_weights_are_shares_that_grow_with_the_rank(kind, count):
    weights = Statistic(kind=kind, level=0.8).ranked_weights(count)
    assert weights.sum() == pytest.approx(1.0)
    assert weights.min() >= 0.0
    if kind != "quantile":
        assert (np.diff(weights) >= 0).all()


def test_a_scenario_without_score_counts_where_it_ranks():
    scores = np.append(np.arange(9.0), np.nan)
    assert np.isnan(Statistic(kind="cvar", level=0.8).of(scores))
    assert Statistic(kind="quantile", level=0.5).of(scores) == pytest.approx(4.5)
