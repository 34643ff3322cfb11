"""What a population's scores say: quantiles, failure probabilities, what moves them, and the worst cases.

All intervals are of 95 %. Scenarios that did not run to an end have no scores: they are counted by reason, left
out of the quantiles, and count as failures.
"""

from __future__ import annotations

import json
import operator
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from tuning.files.seal import seal_tables
from tuning.files.whole import write_text
from tuning.problem.interface import Status
from tuning.scoring.remedies import TARGET, Remedy, advise, find_remedy
from tuning.study.population import Population, parse_failure
from tuning.study.scores import SCORES, unit_of

LEVELS = (0.05, 0.25, 0.5, 0.75, 0.95, 0.99)
_COMPARE = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge}
_RESAMPLES = 999
_MATTERS = 0.05
"""Share of the variance from which a factor is said to matter."""
Columns = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Interval:
    """An estimate with its 95 % interval.

    Args:
        value: the estimate.
        low: lower end.
        high: upper end; with `low` NaN where the data do not suffice.
    """

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Influence:
    """How a factor moves a metric.

    Args:
        first: share of the variance that it explains by itself (first-order Sobol index).
        total: share that goes with it, its interactions included (total index).
    """

    first: Interval
    total: Interval


@dataclass(frozen=True)
class Summary:
    """All that a Monte Carlo run says.

    Args:
        scenarios: how many were run.
        status: how many ended how, by reason; "scored" ones count.
        quantiles: of every metric, by level.
        failures: probability of every failure that the study defines.
        correlations: Spearman's rank correlation of the objective with every number, by path.
        influences: Sobol indices of log10 of the objective, by factor; empty without a design.
        unexplained: scenarios of the design whose objective was not finite or not positive.
        worst: numbers of the scenarios with the largest objective, worst first.
        sentences: the same for people.
        remedies: what would bring each failure down to the share that may fail; none of those that are there.
        advice: the same for people, line by line.
    """

    scenarios: int
    status: dict[str, int]
    quantiles: dict[str, dict[float, Interval]]
    failures: dict[str, Interval]
    correlations: dict[str, Interval]
    influences: dict[str, Influence]
    unexplained: int
    worst: list[int]
    sentences: list[str]
    remedies: list[Remedy] = field(default_factory=list)
    advice: list[str] = field(default_factory=list)

    def as_tables(self) -> dict[str, Any]:
        """Return the summary as nested tables."""
        return asdict(self)


def quantile(values: np.ndarray, level: float) -> Interval:
    """Return a quantile with its distribution-free interval, from the ranks of the order statistics."""
    if not values.size:
        return Interval(float("nan"), float("nan"), float("nan"))
    found = scipy.stats.quantile_test(values, p=level).confidence_interval(0.95)
    return Interval(float(np.quantile(values, level, method="inverted_cdf")), float(found.low), float(found.high))


def probability(failed: np.ndarray) -> Interval:
    """Return a probability with its Clopper–Pearson interval."""
    found = scipy.stats.binomtest(int(failed.sum()), failed.size).proportion_ci(0.95, method="exact")
    return Interval(float(failed.mean()), float(found.low), float(found.high))


def has_failed(columns: Columns, name: str, text: str) -> np.ndarray:
    """Return which scenarios fail by a definition; one without scores does."""
    metric, comparison, limit = parse_failure(name, text)
    values = columns[metric]
    return _COMPARE[comparison](values, limit) | np.isnan(values) | (columns["status"] != Status.OK)


def sobol_influences(
    design: Columns, factors: Sequence[str], metric: str, *, seed: int = 0
) -> tuple[dict[str, Influence], int]:
    """Return Sobol indices of log10 of a metric from the scores of a Saltelli design.

    Args:
        design: columns of the design: matrices A, B, and A with each factor's columns of B, one after the other.
        factors: names, in the design's order.
        metric: a positive metric.
        seed: of the bootstrap, so that the intervals repeat to the bit.

    Returns:
        The influences by factor, and how many scenarios had to be replaced by the worst finite one.
    """
    values = np.where(design["status"] == Status.OK, design[metric], np.nan)
    usable = np.isfinite(values) & (values > 0)
    if not usable.any():
        return {}, int(values.size)
    filled = np.log10(np.where(usable, values, values[usable].max()))
    rows = filled.size // (len(factors) + 2)
    if not np.ptp(filled) > 0:
        return {}, int(np.sum(~usable))
    matrices = filled.reshape(len(factors) + 2, rows)
    matrices = matrices - matrices[:2].mean()
    with warnings.catch_warnings():
        # A factor without any effect has no scatter to resample: its interval is then the value.
        warnings.simplefilter("ignore", RuntimeWarning)
        # Not the bootstrap of scipy.stats.sobol_indices: it draws from no seed, and takes no single factor.
        spread = scipy.stats.bootstrap(
            [np.arange(rows)],
            # Sorted: resamples of the same rows are then equal to the last digit, which the method counts ties by.
            lambda row: _sobol_indices(matrices[:, np.sort(row)]),
            vectorized=False,
            n_resamples=_RESAMPLES,
            method="BCa",
            rng=np.random.default_rng(seed),
        )
    first, total = _intervals(_sobol_indices(matrices), spread.confidence_interval)
    return dict(zip(factors, map(Influence, first, total), strict=True)), int(np.sum(~usable))


def _sobol_indices(matrices: np.ndarray) -> np.ndarray:
    """Return `(2, factor)` first-order and total indices from the `(matrix, row)` values of a Saltelli design.

    With A, B and Aᵢ (A with factor i's columns of B): Sᵢ = mean(B (Aᵢ − A))/V and Tᵢ = mean((A − Aᵢ)²)/2V, where
    V is the variance over A and B.

    References:
        Saltelli et al., Variance based sensitivity analysis of model output, Computer Physics Communications 181
        (2010), table 2, (b) and (f).
    """
    a, b, mixed = matrices[0], matrices[1], matrices[2:]
    first = np.mean(b * (mixed - a), axis=-1)
    total = 0.5 * np.mean((a - mixed) ** 2, axis=-1)
    variance = np.var(matrices[:2])
    return np.stack([first, total]) / variance if variance > 0.0 else np.zeros((2, len(mixed)))


def _intervals(values: np.ndarray, ends: Any) -> list[list[Interval]]:
    low, high = (np.where(np.isnan(end), values, end) for end in (ends.low, ends.high))
    numbers = zip(values.tolist(), low.tolist(), high.tolist(), strict=True)
    return [[Interval(*one) for one in zip(*rows, strict=True)] for rows in numbers]


def summarise(
    columns: Columns,
    design: Columns | None,
    population: Population,
    factors: Sequence[str],
    objective: str,
    worst: int,
    *,
    seed: int = 0,
    numbers: Mapping[str, float] | None = None,
    target: float = TARGET,
) -> Summary:
    """Summarise a Monte Carlo run.

    Args:
        columns: rows of the population, `(scenario,)` by column.
        design: rows of the design for Sobol indices, if there is one.
        population: what varied, and what counts as a failure.
        factors: names of the design's factors.
        objective: the metric that correlations, influences and the worst cases are about.
        worst: how many of the worst to list.
        seed: of what is resampled.
        numbers: the study's own, by path.
        target: share of the robots that may fail.
    """
    status = columns["status"]
    counted = status == Status.OK
    kept = {name: values[counted] for name, values in columns.items()}
    counts = Counter(Status(int(code)).reason for code in status)
    quantiles = {
        m: {level: quantile(kept[m][~np.isnan(kept[m])], level) for level in LEVELS} for m in SCORES if m in kept
    }
    failures = {name: probability(has_failed(columns, name, text)) for name, text in population.failures.items()}
    influences, unexplained = (
        ({}, 0) if design is None else sobol_influences(design, factors, objective, seed=seed)
    )
    # Scenarios without scores are the worst of all.
    badness = np.where(counted & ~np.isnan(columns[objective]), columns[objective], np.inf)
    order = np.argsort(-badness, kind="stable")[:worst]
    summary = Summary(
        scenarios=status.size,
        status=dict(counts),
        quantiles=quantiles,
        failures=failures,
        correlations={path: _correlation(kept[path], kept[objective]) for path in population.paths},
        influences=influences,
        unexplained=unexplained,
        worst=[int(columns["scenario"][i]) for i in order],
        sentences=[],
    )
    remedies, advice = _remedies(columns, population, numbers or {}, target)
    sentences = _sentences(summary, population, objective)
    return replace(summary, sentences=sentences, remedies=remedies, advice=advice)


def _remedies(
    columns: Columns, population: Population, numbers: Mapping[str, float], target: float
) -> tuple[list[Remedy], list[str]]:
    """Return what would bring the failures down to the target, and the same for people."""
    remedies, lines = [], []
    varied = {path: columns[path] for path in population.paths}
    for name, text in population.failures.items():
        found = find_remedy(name, has_failed(columns, name, text), varied, target)
        if found is not None:
            remedies.append(found)
            lines += advise(found, define(name, text), numbers)
    if population.failures and not remedies:
        lines.append(f"nothing: of no failure more than {100.0 * target:.3g} % of the robots have it")
    return remedies, lines


def define(name: str, text: str) -> str:
    """Return a failure's definition with the unit of its metric."""
    metric, comparison, limit = parse_failure(name, text)
    return f"{metric} {comparison} {limit:g}{unit_of(metric)}"


def _correlation(numbers: np.ndarray, scores: np.ndarray) -> Interval:
    finite = np.isfinite(scores)
    if finite.sum() < 4 or not np.ptp(numbers[finite]) > 0 or not np.ptp(scores[finite]) > 0:
        return Interval(float("nan"), float("nan"), float("nan"))
    value = float(scipy.stats.spearmanr(numbers[finite], scores[finite])[0])  # pyright: ignore[reportArgumentType]
    # Fisher's transformation, with Bonett and Wright's variance for ranks.
    reach = 1.959964 * np.sqrt((1.0 + value**2 / 2.0) / (finite.sum() - 3))
    centre = np.arctanh(np.clip(value, -1 + 1e-12, 1 - 1e-12))
    return Interval(value, float(np.tanh(centre - reach)), float(np.tanh(centre + reach)))


def _sentences(summary: Summary, population: Population, objective: str) -> list[str]:
    found, unit = [], unit_of(objective)
    median, high = (summary.quantiles[objective][level] for level in (0.5, 0.95))
    found.append(
        f"half of the robots stay below {objective} {median.value:.4g}{unit} {_ends(median)}, "
        f"95 % of them below {high.value:.4g}{unit} {_ends(high)}"
    )
    found += [
        f"{name} ({define(name, population.failures[name])}): {100 * p.value:.3g} % fail "
        f"[{100 * p.low:.3g}, {100 * p.high:.3g}] %"
        for name, p in summary.failures.items()
    ]
    lost = {reason: n for reason, n in summary.status.items() if reason != Status.OK.reason}
    found += [f"{n} of {summary.scenarios} have no score: {reason}" for reason, n in lost.items()]
    if summary.influences:
        ranked = sorted(summary.influences.items(), key=lambda item: -item[1].total.value)
        for name, influence in ranked:
            first, total = influence.first, influence.total
            if total.low > _MATTERS:
                found.append(
                    f"{name} matters: of the variance of log10 {objective} {_share(first)} by itself, "
                    f"{_share(total)} with interactions"
                )
        small = [name for name, influence in ranked if influence.total.high < _MATTERS]
        if small:
            found.append(f"below {100 * _MATTERS:.0f} % each, with interactions: {', '.join(small)}")
        open_ones = [
            f"{name} ({_share(i.total)})"
            for name, i in ranked
            if not (i.total.low > _MATTERS or i.total.high < _MATTERS)
        ]
        if open_ones:
            found.append(f"undecided with this design: {', '.join(open_ones)}")
    if summary.unexplained:
        found.append(f"{summary.unexplained} scenarios of the design had no score and count as the worst that had")
    return found


def _ends(interval: Interval) -> str:
    """Return an interval in brackets; a dash for an end that so few scenarios do not give."""
    return f"[{', '.join('–' if np.isnan(end) else f'{end:.4g}' for end in (interval.low, interval.high))}]"


def _share(index: Interval) -> str:
    """Return a share of a variance; estimates of a small one may come out below 0, or above all of it."""
    value, low, high = (100.0 * min(max(x, 0.0), 1.0) for x in (index.value, index.low, index.high))
    return f"{value:.0f} % [{low:.0f}, {high:.0f}]"


def write_summary(summary: Summary, path: Path) -> None:
    """Write a summary as JSON with its seal; infinite and missing numbers become text."""
    tables = json.loads(json.dumps(summary.as_tables()), parse_constant=str)
    write_text(path, json.dumps(seal_tables(tables), indent=2) + "\n")
