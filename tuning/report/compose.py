"""The report on a run, and on two."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tuning.pictures.page import Page, Picture
from tuning.report import tables
from tuning.report.comparison import describe_comparison, describe_contest
from tuning.report.effort import show_effort, tabulate_effort
from tuning.report.elements import say_difference, say_value, show_distributions, show_traces
from tuning.report.gather import Contestant, FinishedRun, is_paired, short_names
from tuning.report.pictures import scores as pictures
from tuning.report.population import describe_population
from tuning.report.searches import describe_sweep, describe_tuning
from tuning.study.base import to_toml
from tuning.study.kinds import kind_of
from tuning.study.scores import title_of

_DESCRIBE = {
    "montecarlo": describe_population,
    "sweep": describe_sweep,
    "tune": describe_tuning,
    "compare": describe_comparison,
    "contest": describe_contest,
}


def report_run(run: FinishedRun) -> Page:
    """Return the report on a run."""
    parts = _DESCRIBE[run.command](run)
    sources = [("The full study", to_toml(run.manifest["study"]))]
    if run.command == "tune":
        sources.append(("The tuned study, best.toml", (run.folder / "best.toml").read_text(encoding="utf-8")))
    return Page(
        title=f"{run.command}: {run.study.name}",
        headline=parts.headline,
        pictures=list(parts.pictures),
        findings=parts.findings,
        tables=parts.tables,
        provenance=tables.tabulate_provenance({"": run}),
        sources=sources,
    )


def report_pair(first: FinishedRun, second: FinishedRun) -> Page:
    """Return the report on two runs of one command."""
    names = short_names([str(first.folder), str(second.folder)])
    a, b = (replace(run.best, name=name) for run, name in zip((first, second), names, strict=True))
    statistic, seed = first.study.tune.statistic, first.study.seed
    same = is_paired(first, second)
    said = f"{a.name}: {say_value(first, a)}; {b.name}: {say_value(first, b)}"
    if same:
        headline = f"{said}. On what both ran, {b.name} minus {a.name}: {say_difference(first, a, b)}."
    else:
        headline = f"{said}. They did not run the same scenarios, so nothing is paired."
    found = []
    if first.command == "montecarlo" and kind_of(first.study).told is None:
        summaries = {a.name: first.summary, b.name: second.summary}
        definitions = _definitions(first.study.population.failures, second.study.population.failures)
        found += [
            tables.tabulate_quantiles_of_two(summaries),
            tables.tabulate_failures_of_two(summaries, definitions),
        ]
    if same:
        found.append(tables.tabulate_differences(a, b, statistic, seed))
    found += [
        tables.tabulate_scores([a, b], seed, statistic),
        tables.tabulate_changes(tables.study_tables(a), tables.study_tables(b), (a.name, b.name)),
    ]
    runs = {a.name: first, b.name: second}
    if first.command == "tune":
        found.insert(0, tabulate_effort(runs))
    return Page(
        title=f"{first.command}: {a.name} and {b.name}",
        headline=headline,
        pictures=list(_pair_pictures(runs, a, b, same=same)),
        tables=[table for table in found if table.rows or table.note],
        provenance=tables.tabulate_provenance(runs),
        findings=[
            f"{name} stands for its best: {run.best.name}"
            for name, run in runs.items()
            if run.command != "montecarlo"
        ],
        sources=[(f"The full study of {name}", to_toml(run.manifest["study"])) for name, run in runs.items()],
    )


def _definitions(first: dict[str, str], second: dict[str, str]) -> dict[str, str]:
    return {
        name: " / ".join(dict.fromkeys(each[name] for each in (first, second) if name in each))
        for name in {**first, **second}
    }


def _pair_pictures(runs: dict[str, FinishedRun], a: Contestant, b: Contestant, *, same: bool) -> Iterator[Picture]:
    run = next(iter(runs.values()))
    objective = run.objective
    yield show_distributions([a, b], objective)
    if run.command == "tune":
        yield from show_effort(runs)
    if same:
        first, second = tables.both_finite(a.scores[objective], b.scores[objective])
        yield Picture(
            "Scenario by scenario",
            pictures.draw_pairs(first, second, (a.name, b.name), objective),
            f"A point a scenario; below the line, {b.name} is better.",
            f"{title_of(objective)} of {b.name} against that of {a.name} in {first.size} scenarios; "
            f"{b.name} is better in {int(np.sum(second < first))}.",
        )
    for run, one in zip(runs.values(), (a, b), strict=True):
        yield from show_traces(run, one, f": {one.name}")
    if "convergence_time" in a.scores and "convergence_time" in b.scores:
        yield replace(show_distributions([a, b], "convergence_time"), title="Convergence times over each other")
