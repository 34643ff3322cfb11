"""The report on a comparison."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from tuning.report import tables
from tuning.report.elements import Parts, say_difference, say_value, show_distributions, show_traces
from tuning.report.gather import FinishedRun
from tuning.report.page import Picture

_CONTENDERS = 6
"""Estimators whose traces are shown."""


def describe_comparison(run: FinishedRun) -> Parts:
    """Return what there is to say of a comparison."""
    first, best = run.contestants[0], run.best
    headline = f"Best of {len(run.contestants)}: {best.name}, {say_value(run, best)}."
    if best is first and len(run.contestants) > 1:
        headline += f" Next to it the first of the others: {run.contestants[1].name}, "
        headline += f"{say_value(run, run.contestants[1])}; {say_difference(run, best, run.contestants[1])}."
    elif best is not first:
        headline += f" Against {first.name}, {say_value(run, first)}: {say_difference(run, first, best)}."
    statistic, seed = run.study.tune.statistic, run.study.seed
    found = [tables.tabulate_scores(run.contestants, seed, statistic)]
    found += [
        replace(
            tables.tabulate_differences(first, one, statistic, seed),
            title=f"Paired: {one.name} minus {first.name}",
        )
        for one in run.contestants[1:]
    ]
    missing = [one.name for one in run.contestants if one.study is None]
    findings = []
    if missing:
        findings.append(f"no traces of {', '.join(missing)}: its file is gone, or no longer what was compared")
    if len(run.contestants) > _CONTENDERS:
        findings.append(f"traces of the first {_CONTENDERS} only")

    return Parts(headline, _comparison_pictures(run), found, findings)


def _comparison_pictures(run: FinishedRun) -> Iterator[Picture]:
    yield show_distributions(run.contestants, run.objective)
    for one in run.contestants[:_CONTENDERS]:
        yield from show_traces(run, one, f"True and estimated stiffness: {one.name}")
