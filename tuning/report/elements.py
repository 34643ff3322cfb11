"""What reports on several commands say and show: sentences with intervals, and pictures with their words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tuning.pictures.page import Picture, Table, number, signed
from tuning.problem.interface import Stream
from tuning.report import tables
from tuning.report.gather import Contestant, FinishedRun
from tuning.report.pictures import scores as pictures
from tuning.report.pictures.populations import draw_numbers
from tuning.report.pictures.searches import draw_each
from tuning.study.base import Study
from tuning.study.kinds import kind_of
from tuning.study.scores import SCORES, title_of, unit_of

SHOWN = 32
"""Scenarios in a band over time."""
_LINES = 30


@dataclass(frozen=True)
class Parts:
    """What a report is made of.

    Args:
        headline: the main numbers.
        pictures: in order, drawn one by one.
        tables: in order.
        findings: further sentences.
    """

    headline: str
    pictures: Iterator[Picture]
    tables: list[Table]
    findings: list[str]


def say_value(run: FinishedRun, one: Contestant) -> str:
    """Return the statistic of a contestant's objective with its interval."""
    values = one.scores[run.objective]
    values = values[np.isfinite(values)]
    statistic = run.study.tune.statistic
    if not values.size:
        return f"no finite {run.objective}"
    found = tables.estimated(values, statistic, seed=run.study.seed)
    value = f"{SCORES[run.objective].label} {number(found.value)}{unit_of(run.objective)}"
    if values.size == 1:
        return value
    value = f"{statistic.label} {value}"
    return value if np.isnan(found.low) else f"{value} [{number(found.low)}, {number(found.high)}]"


def say_difference(run: FinishedRun, first: Contestant, second: Contestant) -> str:
    """Return how much better or worse the second is, scenario by scenario."""
    a, b = tables.both_finite(first.scores[run.objective], second.scores[run.objective])
    found = tables.paired(a, b, run.study.tune.statistic, seed=run.study.seed)
    if a.size == 1:
        return f"difference {signed(found.value)}{unit_of(run.objective)}"
    wins = f"{100 * float(np.mean(b < a)):.0f}" if a.size else "–"
    ends = "" if np.isnan(found.low) else f" [{signed(found.low)}, {signed(found.high)}]"
    difference = f"{signed(found.value)}{unit_of(run.objective)}{ends}"
    return f"paired difference {difference}, better in {wins} % of {a.size} scenarios"


def medians_of(groups: dict[str, np.ndarray]) -> str:
    """Return the sizes and medians of groups of scores."""

    def middle(values: np.ndarray) -> str:
        finite = values[np.isfinite(values)]
        return f"median {number(float(np.median(finite)))}" if finite.size else "no score"

    return ", ".join(f"{name} ({values.size}) {middle(values)}" for name, values in groups.items())


def show_traces(run: FinishedRun, one: Contestant, of: str) -> Iterator[Picture]:
    """Show scenarios of a contestant over time, simulated again; nothing where its study is not known."""
    if one.study is not None:
        count = SHOWN if run.command == "montecarlo" else min(SHOWN, one.study.scenarios.held_out)
        yield from show_over_time(one.study, run.stream, range(count), of=of)


def show_over_time(
    study: Study, stream: Stream, shown: Sequence[int], *, of: str = "", cases: Mapping[int, str] | None = None
) -> Iterator[Picture]:
    """Show scenarios of a study over time, as its kind does; nothing where that has nothing to show."""
    traces = kind_of(study).traces
    if traces is not None:
        yield from traces.load()(study, stream, shown, of=of, cases=cases or {})


def show_distributions(contestants: list[Contestant], metric: str) -> Picture:
    """Show how a metric is distributed for each contestant."""
    groups = {one.name: one.scores[metric] for one in contestants}
    if all(values.size == 1 for values in groups.values()):
        told = ", ".join(f"{name} {number(float(values[0]))}" for name, values in groups.items())
        return Picture(
            "Scores side by side",
            draw_each(groups, metric),
            "Further left is better.",
            f"{title_of(metric)}: {told}.",
        )
    return Picture(
        "Scores over each other",
        pictures.draw_shares(groups, metric),
        "Share of the scenarios whose score is below; further left is better. In brackets: scenarios.",
        f"Distributions of {title_of(metric)}: {medians_of(groups)}.",
    )


def show_causes(rows: dict[str, np.ndarray], names: list[str], objective: str) -> Picture:
    """Show the objective against each number that varies."""
    return Picture(
        "Score against each number",
        draw_numbers(rows, names, objective, across=2),
        "Median and 90 % band of the score among scenarios in which the number is about there.",
        f"{title_of(objective)} against {', '.join(names)}: median and 90 % band.",
    )


def show_front(accuracy: np.ndarray, time: np.ndarray, label: str) -> Picture:
    """Show configurations by accuracy [%] and convergence time [s]."""
    chosen = pictures.front(accuracy, time)
    lost = int(np.sum(~(np.isfinite(accuracy) & np.isfinite(time))))
    ends = ""
    if chosen.size:
        first, last = chosen[0], chosen[-1]
        ends = (
            f" from {number(float(accuracy[first]))} % in {number(float(time[first]))} s"
            f" to {number(float(accuracy[last]))} % in {number(float(time[last]))} s"
        )
    return Picture(
        "Accuracy against convergence time",
        pictures.draw_front(accuracy, time, label),
        f"Blue: no other configuration is better in both{ends}. Left out, as they never converge: {lost}.",
        f"Pareto front of {chosen.size} of {accuracy.size} configurations{ends}.",
    )


def show_parallel(rows: list[dict[str, Any]], names: list[str], score: str, label: str) -> Picture:
    """Show the best configurations, which come first, across their numbers."""
    shown = rows[: min(_LINES, max(2, len(rows) // 3))]
    best = ", ".join(f"{name} = {number(float(rows[0][name]))}" for name in names)
    return Picture(
        f"The best {len(shown)} of {len(rows)} configurations",
        pictures.draw_parallel(shown, names, score, label),
        "A line a configuration, the thick one is the best; each axis spans the numbers of those shown.",
        f"Parallel coordinates of {len(shown)} configurations by {label}; best: {best}.",
    )


def renamed(row: dict[str, float], paths: list[str], names: list[str]) -> dict[str, Any]:
    """Return a row with its numbers under other names too."""
    return {**row, **{name: row[path] for path, name in zip(paths, names, strict=True)}}
