"""What can be said of scores over scenarios: statistics with intervals, and paired differences."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np
import scipy

from tuning.study.base import Tune
from tuning.study.scores import time_of
from tuning.study.statistic import Statistic

_RESAMPLES = 5000
_ROUNDING = 1e-9
"""Two scores are equal that differ by less than this share: a thousand times the rounding of 1e4 additions."""


@dataclass(frozen=True)
class Judgement:
    """An objective over scenarios [%].

    Args:
        statistic: what the search sums the scenarios up by: its name.
        value: that statistic of the objective over the scenarios.
        low: lower end of its 95 % bootstrap interval.
        high: upper end.
        mean: of the objective over the scenarios.
        median: over the scenarios.
        q90: 90 % quantile.
        msrep_mean: mean of the printed index; `None` where no estimate is judged.
        settled_mean: mean of the same from the warm-up time on; `None` likewise.
        coverage: mean share of the known samples whose truth is inside the band; `None` likewise, NaN where no
            sample of any scenario is known.
        coverage_low: lower end of its 95 % bootstrap interval over the scenarios in which any is known.
        coverage_high: upper end.
        known_share: mean share of samples at which the answer is known; `None` likewise.
        convergence_time: median over the scenarios, of a control loop that of its settling time; `None` where
            nothing moves [s].
        diverged: scenarios in which an estimate was not finite; they are left out of the other numbers.
        scenarios: how many were run.
        each: the objective in every scenario [%].
    """

    statistic: str
    value: float
    low: float
    high: float
    mean: float
    median: float
    q90: float
    msrep_mean: float | None
    settled_mean: float | None
    coverage: float | None
    coverage_low: float | None
    coverage_high: float | None
    known_share: float | None
    convergence_time: float | None
    diverged: int
    scenarios: int
    each: np.ndarray

    def summary(self) -> dict[str, float | int]:
        """Return all but the single scenarios."""
        return {name: value for name, value in asdict(self).items() if name != "each" and value is not None}


def judge(scores: Mapping[str, np.ndarray], tune: Tune, *, seed: int) -> Judgement:
    """Judge `(scenario,)` scores by a study's objective and statistic; `seed` draws the bootstrap."""
    is_finite = scores["diverged"] == 0
    # Where none is left, the numbers are those of the diverged scenarios: NaN.
    kept = is_finite if is_finite.any() else ~is_finite
    values = scores[tune.objective][kept]
    low, high = interval(values, tune.statistic, seed=seed)
    time = time_of(tune.objective)

    def mean(name: str) -> float | None:
        return float(np.mean(scores[name][kept])) if name in scores else None

    covered = scores["coverage"][kept] if "coverage" in scores else None
    ends: tuple[float | None, float | None] = (None, None)
    if covered is not None:
        covered = covered[np.isfinite(covered)]
        ends = interval(covered, Statistic(), seed=seed)
    return Judgement(
        statistic=tune.statistic.label,
        value=float(tune.statistic.of(values)),
        low=low,
        high=high,
        mean=float(np.mean(values)),
        median=float(np.median(values)),
        q90=float(np.quantile(values, 0.9)),
        msrep_mean=mean("msrep"),
        settled_mean=mean("msrep_settled"),
        coverage=None if covered is None else float(np.mean(covered)) if covered.size else float("nan"),
        coverage_low=ends[0],
        coverage_high=ends[1],
        known_share=mean("known_share"),
        convergence_time=None if time is None else float(np.median(scores[time][kept])),
        diverged=int(np.sum(~is_finite)),
        scenarios=values.size + int(np.sum(~kept)),
        each=scores[tune.objective],
    )


def interval(values: np.ndarray, statistic: Statistic, *, seed: int) -> tuple[float, float]:
    """Return the 95 % bootstrap interval of a statistic; NaN where the values do not scatter.

    BCa for a mean; percentile for quantiles and tails, whose jackknife has no limit.
    """
    if values.size < 2 or not np.ptp(values) > 0:
        return float("nan"), float("nan")
    rng, method = np.random.default_rng(seed), "BCa" if statistic.kind == "mean" else "percentile"
    found = scipy.stats.bootstrap((values,), statistic.of, n_resamples=_RESAMPLES, method=method, rng=rng)
    return float(found.confidence_interval.low), float(found.confidence_interval.high)


def equal_to_rounding(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return where scores differ by no more than what the order of their sums does to them.

    The number of cores, and of lanes side by side, change a score of some thousand samples in its last digits.
    """
    return np.abs(second - first) <= _ROUNDING * np.maximum(np.abs(first), np.abs(second))


def paired_interval(
    first: np.ndarray, second: np.ndarray, statistic: Statistic, *, seed: int
) -> tuple[float, float, float]:
    """Return the statistic of `second` minus that of `first`, and its paired 95 % bootstrap interval.

    Where every scenario has the same difference, the interval is that difference. Scores that are equal to
    rounding count as equal.
    """

    def difference(a: np.ndarray, b: np.ndarray, axis: int = -1) -> np.ndarray:
        return statistic.of(b, axis) - statistic.of(a, axis)

    if not first.size:
        return float("nan"), float("nan"), float("nan")
    second = np.where(equal_to_rounding(first, second), first, second)
    value = float(difference(first, second))
    if first.size < 2:
        return value, float("nan"), float("nan")
    if not np.ptp(second - first) > 0:
        return value, value, value
    found = scipy.stats.bootstrap(
        (first, second),
        difference,
        paired=True,
        vectorized=True,
        n_resamples=_RESAMPLES,
        method="percentile",
        rng=np.random.default_rng(seed),
    )
    return value, float(found.confidence_interval.low), float(found.confidence_interval.high)


MEAN = Statistic()
