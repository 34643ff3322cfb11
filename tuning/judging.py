"""What can be said of scores over scenarios: means with intervals, and paired differences."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np
from scipy import stats

_RESAMPLES = 5000


@dataclass(frozen=True)
class Judgement:
    """An objective over scenarios, with a 95 % bootstrap interval of its mean [%].

    Args:
        mean: of the objective over the scenarios.
        low: lower end of the interval.
        high: upper end.
        median: over the scenarios.
        q90: 90 % quantile.
        msrep_mean: mean of the printed index.
        settled_mean: mean of the same from the warm-up time on.
        convergence_time: median over the scenarios [s].
        diverged: scenarios in which an estimate was not finite; they are left out of the other numbers.
        scenarios: how many were run.
        each: the objective in every scenario [%].
    """

    mean: float
    low: float
    high: float
    median: float
    q90: float
    msrep_mean: float
    settled_mean: float
    convergence_time: float
    diverged: int
    scenarios: int
    each: np.ndarray

    def summary(self) -> dict[str, float | int]:
        """Return all but the single scenarios."""
        return {name: value for name, value in asdict(self).items() if name != "each"}


def judge(scores: Mapping[str, np.ndarray], objective: str, *, seed: int) -> Judgement:
    """Judge `(scenario,)` scores by one of them; `seed` draws the bootstrap."""
    is_finite = scores["diverged"] == 0
    # Where none is left, the numbers are those of the diverged scenarios: NaN.
    kept = is_finite if is_finite.any() else ~is_finite
    values = scores[objective][kept]
    low, high = mean_interval(values, seed=seed)
    return Judgement(
        mean=float(np.mean(values)),
        low=low,
        high=high,
        median=float(np.median(values)),
        q90=float(np.quantile(values, 0.9)),
        msrep_mean=float(np.mean(scores["msrep"][kept])),
        settled_mean=float(np.mean(scores["msrep_settled"][kept])),
        convergence_time=float(np.median(scores["convergence_time"][kept])),
        diverged=int(np.sum(~is_finite)),
        scenarios=values.size + int(np.sum(~kept)),
        each=scores[objective],
    )


def mean_interval(values: np.ndarray, *, seed: int) -> tuple[float, float]:
    """Return the 95 % bootstrap interval (BCa) of a mean; NaN where the values do not scatter."""
    if values.size < 2 or not np.ptp(values) > 0:
        return float("nan"), float("nan")
    rng = np.random.default_rng(seed)
    interval = stats.bootstrap((values,), np.mean, n_resamples=_RESAMPLES, rng=rng).confidence_interval
    return float(interval.low), float(interval.high)
