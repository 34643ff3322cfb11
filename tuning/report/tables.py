"""The tables of a report."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy

from tuning.pictures.page import Table, number, signed, span
from tuning.report.gather import Contestant, FinishedRun
from tuning.report.pictures.scores import short_paths
from tuning.report.pictures.searches import NEAR
from tuning.scoring.intervals import interval, paired_interval
from tuning.scoring.summary import Interval, Summary
from tuning.study.base import resolved
from tuning.study.scores import SCORES, title_of
from tuning.study.statistic import Statistic

_LEVELS = (0.05, 0.5, 0.95)
_BOOTSTRAP = 8192
"""Scenarios up to which intervals are bootstrapped; beyond, memory would not hold it."""
_BLOCKS = 32
_ROWS = 15
STATISTICS = (Statistic(), Statistic(kind="quantile", level=0.5), Statistic(kind="quantile", level=0.95))
INTERVALS = "In brackets: 95 % intervals."


def bracketed(value: Interval, scale: float = 1.0) -> str:
    """Return an estimate with its interval."""
    return f"{number(scale * value.value)} [{number(scale * value.low)}, {number(scale * value.high)}]"


def tabulate_quantiles(summary: Summary) -> Table:
    """Return the quantiles of every metric over a population."""
    levels = list(next(iter(summary.quantiles.values())))
    rows = [[title_of(m), *(bracketed(q) for q in found.values())] for m, found in summary.quantiles.items()]
    headers = ["score", *(f"{100 * level:g} %" for level in levels)]
    return Table("Quantiles over the robots", headers, rows, f"{INTERVALS} They are distribution-free.")


def tabulate_failures(summary: Summary, definitions: Mapping[str, str]) -> Table:
    """Return failure probabilities, and how scenarios ended."""
    rows = [[name, definitions.get(name, ""), bracketed(p, 100.0)] for name, p in summary.failures.items()]
    rows += [
        ["how it ended", reason, f"{number(100.0 * n / summary.scenarios)} ({n} of {summary.scenarios})"]
        for reason, n in summary.status.items()
    ]
    note = f"{INTERVALS} Clopper–Pearson. A scenario without scores fails by every definition."
    return Table("Failures", ["failure", "definition", "share [%]"], rows, note)


def tabulate_influences(summary: Summary, objective: str) -> Table:
    """Return Sobol indices, and rank correlations, largest first."""
    if not summary.influences:
        ranked = sorted(summary.correlations.items(), key=lambda item: -abs(item[1].value))
        rows = [[name, bracketed(c)] for name, c in ranked]
        headers = ["number", f"rank correlation with {objective}"]
        return Table("What goes with the score", headers, rows, f"{INTERVALS} Spearman's.")
    ranked = sorted(summary.influences.items(), key=lambda item: -item[1].total.value)
    rows = []
    for name, influence in ranked:
        correlation = summary.correlations.get(name)
        shares = [bracketed(influence.first, 100.0), bracketed(influence.total, 100.0)]
        rows.append([name, *shares, "–" if correlation is None else bracketed(correlation)])
    headers = ["factor", "by itself [%]", "with interactions [%]", "rank correlation"]
    note = f"Sobol indices: shares of the variance of log10 {objective}. {INTERVALS}"
    return Table("What moves the score", headers, rows, note)


def tabulate_scores(contestants: Sequence[Contestant], seed: int, statistic: Statistic) -> Table:
    """Return quantiles of every metric side by side; of one scenario, its scores."""
    if all(values.size == 1 for one in contestants for values in one.scores.values()):
        return _tabulate_each(contestants)
    rows = []
    for metric in SCORES:
        shown = [c.scores[metric][~np.isnan(c.scores[metric])] for c in contestants if metric in c.scores]
        if len(shown) != len(contestants) or any(not values.size for values in shown):
            continue
        cells: list[object] = [title_of(metric)]
        for values in shown:
            found = estimated(values, statistic, seed=seed)
            cells += [found.value, span(found.low, found.high)]
            cells += [float(np.quantile(values, level, method="inverted_cdf")) for level in _LEVELS]
        rows.append(cells)
    headers = ["score"]
    for contestant in contestants:
        own = f"{contestant.name}: " if len(contestants) > 1 else ""
        headers += [f"{own}{statistic.label}", "95 % interval", *(f"{100 * level:g} %" for level in _LEVELS)]
    sizes = ", ".join(f"{c.name} {next(iter(c.scores.values())).size}" for c in contestants)
    lost = sum(int(np.isnan(next(iter(c.scores.values()))).sum()) for c in contestants)
    note = f"Scenarios: {sizes}; without scores and left out: {lost}. The last columns are quantiles over them."
    return Table("Scores", headers, rows, note)


def _tabulate_each(contestants: Sequence[Contestant]) -> Table:
    """Return the scores of the one scenario that there is."""
    rows: list[list[object]] = []
    for metric in SCORES:
        found = [float(one.scores[metric][0]) for one in contestants if metric in one.scores]
        if len(found) == len(contestants) and not np.isnan(found).any():
            rows.append([title_of(metric), *found])
    note = "Of one scenario: there is nothing to take an interval of."
    return Table("Scores", ["score", *(one.name for one in contestants)], rows, note)


def estimated(values: np.ndarray, statistic: Statistic, *, seed: int) -> Interval:
    """Return a statistic with its 95 % interval; that is unknown where some value is infinite."""
    with np.errstate(invalid="ignore"):
        # A weight of 0 times an infinite value is passed over.
        value = float(statistic.of(values))
    if not np.isfinite(values).all():
        return Interval(value, np.nan, np.nan)
    if values.size <= _BOOTSTRAP:
        return Interval(value, *interval(values, statistic, seed=seed))
    return _around(value, [float(statistic.of(values[block])) for block in _blocks()])


def _blocks() -> list[slice]:
    return [slice(start, None, _BLOCKS) for start in range(_BLOCKS)]


def _around(value: float, each: Sequence[float]) -> Interval:
    """Return a value with the interval that its scatter over blocks of the scenarios gives."""
    reach = float(scipy.stats.t.ppf(0.975, len(each) - 1) * np.std(each, ddof=1) / np.sqrt(len(each)))
    return Interval(value, value - reach, value + reach)


def tabulate_quantiles_of_two(summaries: Mapping[str, Summary]) -> Table:
    """Return the quantiles of two populations side by side."""
    metrics = next(iter(summaries.values())).quantiles
    headers = ["score", *(f"{name}: {100 * level:g} %" for name in summaries for level in _LEVELS)]
    rows = [
        [title_of(m), *(bracketed(s.quantiles[m][level]) for s in summaries.values() for level in _LEVELS)]
        for m in metrics
    ]
    return Table("Quantiles over the robots", headers, rows, INTERVALS)


def tabulate_failures_of_two(summaries: Mapping[str, Summary], definitions: Mapping[str, str]) -> Table:
    """Return failure probabilities of two populations side by side."""
    names = dict.fromkeys(name for s in summaries.values() for name in s.failures)
    rows = [
        [
            name,
            definitions.get(name, ""),
            *(bracketed(s.failures[name], 100.0) if name in s.failures else "–" for s in summaries.values()),
        ]
        for name in names
    ]
    return Table("Failures [% of the robots]", ["failure", "definition", *summaries], rows, INTERVALS)


def tabulate_ranking(rows: Sequence[Mapping[str, Any]], paths: Sequence[str], score: str, label: str) -> Table:
    """Return the best configurations."""
    best = rows[0][score]
    shown = [
        [i + 1, *(row[path] for path in paths), row[score], *(row[name] for name in _extra(rows))]
        for i, row in enumerate(rows[:_ROWS])
    ]
    near = sum(row[score] <= NEAR * best for row in rows)
    note = f"{len(rows)} configurations, of which {near} lie within {100 * (NEAR - 1):.0f} % of the best."
    return Table("Ranking of configurations", ["rank", *short_paths(paths), label, *_extra(rows)], shown, note)


def _extra(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    names = {"median", "q90", "convergence_time", "diverged", "steps", "message"}
    return [name for name in rows[0] if name in names or name.startswith("choices.")]


def paired(first: np.ndarray, second: np.ndarray, statistic: Statistic, *, seed: int) -> Interval:
    """Return the statistic of `second` minus that of `first`, with its paired 95 % interval.

    By bootstrap; of many scenarios, by the scatter over blocks of them.
    """
    if first.size <= _BOOTSTRAP:
        return Interval(*paired_interval(first, second, statistic, seed=seed))
    value = float(statistic.of(second) - statistic.of(first))
    return _around(value, [float(statistic.of(second[b]) - statistic.of(first[b])) for b in _blocks()])


def both_finite(first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return two scores in the scenarios that both have; the longer one is cut."""
    size = min(first.size, second.size)
    usable = np.isfinite(first[:size]) & np.isfinite(second[:size])
    return first[:size][usable], second[:size][usable]


def tabulate_differences(first: Contestant, second: Contestant, statistic: Statistic, seed: int) -> Table:
    """Return paired differences of scores, second minus first, on the same scenarios."""
    is_single = all(values.size == 1 for values in first.scores.values())
    rows, used = [], dict.fromkeys([statistic] if is_single else [statistic, *STATISTICS])
    for metric in SCORES:
        if metric not in first.scores or metric not in second.scores:
            continue
        a, b = both_finite(first.scores[metric], second.scores[metric])
        cells: list[object] = [title_of(metric)]
        for one in used:
            found = paired(a, b, one, seed=seed)
            ends = "" if np.isnan(found.low) else f" [{signed(found.low)}, {signed(found.high)}]"
            cells.append(f"{signed(found.value)}{ends}")
        wins = f"{100 * np.mean(b > a if SCORES[metric].better == 'high' else b < a):.0f}" if a.size else "–"
        rows.append([*cells, wins, a.size])
    headers = ["score", *(one.label for one in used), f"{second.name} better [% of scenarios]", "scenarios"]
    note = f"{second.name} minus {first.name}, scenario by scenario. {INTERVALS}"
    return Table("Paired differences", headers, rows, note)


def tabulate_changes(first: Mapping[str, Any], second: Mapping[str, Any], names: tuple[str, str]) -> Table:
    """Return what two studies differ in."""
    left, right = _flat(first), _flat(second)
    rows = [
        [path, left.get(path, "–"), right.get(path, "–")]
        for path in dict.fromkeys([*left, *right])
        if left.get(path) != right.get(path) and not path.startswith("provenance")
    ]
    note = "" if rows else "They are the same."
    return Table("What the studies differ in", ["key", *names], rows, note)


def _flat(tables: Mapping[str, Any], prefix: str = "") -> dict[str, object]:
    found: dict[str, object] = {}
    for name, value in tables.items():
        path = f"{prefix}{name}"
        if isinstance(value, Mapping) and value:
            found |= _flat(value, f"{path}.")
        else:
            found[path] = value if isinstance(value, float) else json.dumps(value)
    return found


def tabulate_provenance(runs: Mapping[str, FinishedRun]) -> Table:
    """Return what runs follow from."""
    facts = [
        ("folder", lambda run: str(run.folder)),
        ("command", lambda run: f"vsajax {run.command}"),
        ("study", lambda run: run.study.name),
        ("study hash", lambda run: run.manifest.get("study_hash", "–")),
        ("seed", lambda run: run.study.seed),
        ("plan", lambda run: json.dumps(run.manifest["plan"])),
        ("chunks", lambda run: len(run.manifest.get("chunks", []))),
        ("versions", lambda run: ", ".join(f"{k} {v}" for k, v in run.manifest.get("versions", {}).items())),
    ]
    rows = [[name, *(of(run) for run in runs.values())] for name, of in facts]
    return Table("", ["", *runs] if len(runs) > 1 else [], rows)


def study_tables(contestant: Contestant) -> dict[str, Any]:
    """Return the tables of a contestant's study."""
    return {} if contestant.study is None else resolved(contestant.study)
