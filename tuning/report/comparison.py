"""The reports on a comparison, and on a contest, which ends with one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from tuning.files.errors import InputError
from tuning.pictures.page import Picture, Table, number
from tuning.report import tables
from tuning.report.elements import Parts, say_difference, say_value, show_distributions, show_traces
from tuning.report.gather import FinishedRun, contender_file
from tuning.report.pictures.scores import short_paths
from tuning.study.loading import load_config
from tuning.study.paths import numeric_paths
from tuning.study.scores import unit_of

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


def describe_contest(run: FinishedRun) -> Parts:
    """Return what there is to say of a contest: the comparison that ends it, and what each option was tuned to."""
    parts = describe_comparison(run)
    plan = run.manifest["plan"]
    search = (
        f"Each was tuned by {plan['trials']} trials of {plan['method']}; the best on the training scenarios first."
    )
    tuned = Table("What each was tuned to", ["options", "training", "tuned numbers"], _tuned_rows(run), search)
    return replace(parts, tables=[tuned, *parts.tables])


def _tuned_rows(run: FinishedRun) -> list[list[object]]:
    rows: list[list[object]] = []
    for one, name in zip(run.contestants, run.compared, strict=True):
        study = one.study
        try:
            provenance = load_config(contender_file(run, name)).provenance
        except InputError:
            provenance = {}
        numbers = {} if study is None else numeric_paths(study)
        paths = [path for path in provenance.get("tuned", []) if path in numbers]
        said = ", ".join(
            f"{label} = {number(numbers[path])}" for path, label in zip(paths, short_paths(paths), strict=True)
        )
        value = provenance.get("train", {}).get("value")
        shown = number(float(value)) + unit_of(run.objective) if value is not None else "–"
        rows.append([one.name, shown, said or "nothing: it has no number to tune"])
    return rows


def _comparison_pictures(run: FinishedRun) -> Iterator[Picture]:
    yield show_distributions(run.contestants, run.objective)
    for one in run.contestants[:_CONTENDERS]:
        yield from show_traces(run, one, f": {one.name}")
