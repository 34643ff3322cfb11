"""The reports on a sweep and on a search."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from tuning.pictures.page import Picture, number, valued
from tuning.problem.finding import Finding, find
from tuning.report import tables
from tuning.report.effort import show_effort
from tuning.report.elements import (
    Parts,
    renamed,
    say_difference,
    say_value,
    show_causes,
    show_distributions,
    show_front,
    show_parallel,
    show_traces,
)
from tuning.report.gather import Contestant, FinishedRun
from tuning.report.pictures import scores as pictures
from tuning.report.pictures.scores import short_paths, short_rows
from tuning.report.pictures.searches import NEAR, draw_sweep
from tuning.scoring.sweep import say_edges
from tuning.study.scores import time_of, title_of

_PAIRS = 6
"""Heat maps of a sweep with many axes."""


def describe_sweep(run: FinishedRun) -> Parts:
    """Return what there is to say of a sweep."""
    ranking, names = run.ranking, short_paths(list(run.axes))
    best = ranking[0]
    near = sum(row["mean"] <= NEAR * best["mean"] for row in ranking)
    at = ", ".join(f"{name} = {valued(best[path])}" for name, path in zip(names, run.axes, strict=True))
    diverged = sum(row["diverged"] > 0 for row in ranking)
    headline = (
        f"Best of {len(ranking)} configurations on {run.manifest['plan']['scenarios']} scenarios: "
        f"{say_value(run, run.best)} at {at}. {near} lie within {100 * (NEAR - 1):.0f} % of it"
        + (f"; {diverged} diverged in some." if diverged else ".")
    )
    objective = run.objective
    found = [
        tables.tabulate_ranking(ranking, list(run.axes), "mean", f"mean {title_of(objective)}"),
        replace(
            tables.tabulate_scores(run.contestants, run.study.seed, run.study.tune.statistic),
            title="Scores of the best configuration",
        ),
    ]
    return Parts(headline, _sweep_pictures(run), found, say_edges(run.axes, best))


def _sweep_pictures(run: FinishedRun) -> Iterator[Picture]:
    objective, ranking = run.objective, run.ranking
    names = short_paths(list(run.axes))
    axes = dict(zip(names, run.axes.values(), strict=True))
    rows: list[dict[str, Any]] = [renamed(row, list(run.axes), names) for row in ranking]
    best = ", ".join(f"{name} = {valued(rows[0][name])}" for name in names)
    yield from show_traces(run, run.best, " of the best configuration")
    wide = [name for name in names if len(axes[name]) > 1]
    if len(wide) < 2:
        yield Picture(
            "Score along the axis", draw_sweep(rows, axes, objective), "", f"Mean {objective}; best at {best}."
        )
    for pair in itertools.islice(itertools.combinations(wide, 2), _PAIRS):
        yield Picture(
            f"{pair[0]} and {pair[1]}",
            draw_sweep(rows, axes, objective, pair=pair),
            "Mean score, best over the other axes. Blank: diverged.",
            f"Heat map of mean {objective} over {pair[0]} and {pair[1]}; the best is at {best}, "
            f"and the outline holds all within {100 * (NEAR - 1):.0f} % of it.",
        )
    # Settings have no scale, and numbers that not every structure has no place on one.
    paths = [path for path in run.axes if _is_numeric(run.columns[path])]
    numbers = short_paths(paths)
    scored = [renamed(row, paths, numbers) for row in ranking if np.isfinite(row["mean"])]
    if scored and len(numbers) > 1:
        yield show_parallel(scored, numbers, "mean", f"mean {title_of(objective)}")
    time = time_of(objective)
    if time is not None:
        yield show_front(*_configurations(run, time), f"mean {title_of(objective)}")
    if paths:
        yield show_causes(*short_rows(run.columns, paths), objective)


def _is_numeric(values: np.ndarray) -> bool:
    return values.dtype.kind == "f" and bool(np.isfinite(values).all())


def _configurations(run: FinishedRun, time: str) -> tuple[np.ndarray, np.ndarray]:
    """Return a sweep's configurations by mean objective and the median of a score that is a time."""
    order = np.lexsort((run.columns["scenario"], run.columns["configuration"]))
    count = len(run.ranking)
    accuracy = run.columns[run.objective][order].reshape(count, -1).mean(axis=1)
    return accuracy, np.median(run.columns[time][order].reshape(count, -1), axis=1)


def describe_tuning(run: FinishedRun) -> Parts:
    """Return what there is to say of a search."""
    before, after = run.contestants
    statistic, seed = run.study.tune.statistic, run.study.seed
    count = run.study.scenarios.held_out
    where = "what was held out" if count == 1 else f"{count} held-out scenarios"
    headline = (
        f"Tuning takes {say_value(run, before)} to {say_value(run, after)} on {where}: "
        f"{say_difference(run, before, after)}."
    )
    tried = _tried(run)
    found = [
        tables.tabulate_scores(run.contestants, seed, statistic),
        *([] if count == 1 else [tables.tabulate_differences(before, after, statistic, seed)]),
        replace(
            tables.tabulate_changes(what_is_tuned(before), what_is_tuned(after), ("before", "tuned")),
            title="What tuning changed",
        ),
    ]
    if tried:
        label = f"training {title_of(run.objective)}"
        found.insert(0, tables.tabulate_ranking(tried, _numbers_of(run, tried), "objective", label))
    finding = Finding() if after.study is None else find(run.study, after.study)
    if finding.table is not None:
        found.insert(0, finding.table)
    return Parts(headline, _tune_pictures(run), found, [*finding.notes, *finding.sentences])


def what_is_tuned(contestant: Contestant) -> dict[str, Any]:
    """Return the tables of a contestant's study that a search may change: all but those that describe searches."""
    found = tables.study_tables(contestant)
    return {name: table for name, table in found.items() if name not in {"name", "sweep", "tune", "provenance"}}


def _tried(run: FinishedRun) -> list[dict[str, Any]]:
    """Return all points with a finite objective, best first."""
    objective = run.columns["objective"]
    order = [int(i) for i in np.argsort(objective, kind="stable") if np.isfinite(objective[i])]
    return [
        {
            name: values[i].item() if hasattr(values[i], "item") else values[i]
            for name, values in run.columns.items()
        }
        for i in order
    ]


def _numbers_of(run: FinishedRun, tried: list[dict[str, Any]]) -> list[str]:
    """Return the tuned paths that the best point has; another structure has others."""
    return [path for path in run.study.tune.parameters if path in tried[0] and np.isfinite(tried[0][path])]


def _tune_pictures(run: FinishedRun) -> Iterator[Picture]:
    before, after = run.contestants
    objective = run.objective
    yield from show_traces(run, after, ", tuned")
    yield from show_traces(run, before, " before")
    yield show_distributions(run.contestants, objective)
    tried = _tried(run)
    paths = _numbers_of(run, tried) if tried else []
    tried = [row for row in tried if all(np.isfinite(row[path]) for path in paths)]
    names = short_paths(paths)
    tried = [renamed(row, paths, names) for row in tried]
    label = f"training {title_of(objective)}"
    if len(names) > 1 and len(tried) > 1:
        yield _points(tried, names, label)
        yield show_parallel(tried, names, "objective", label)
    yield from show_effort({"": run})
    if "convergence_time" in run.columns:
        yield show_front(run.columns["objective"], run.columns["convergence_time"], label)


def _points(tried: list[dict[str, Any]], names: list[str], label: str) -> Picture:
    score = np.array([row["objective"] for row in tried])
    ranks = np.argsort(np.argsort(score))
    strength = {}
    for name in names:
        values = np.array([row[name] for row in tried])
        has_spread = np.ptp(values) > 0 and np.ptp(score) > 0
        strength[name] = abs(np.corrcoef(np.argsort(np.argsort(values)), ranks)[0, 1]) if has_spread else 0.0
    first, second = sorted(names, key=lambda name: -strength[name])[:2]
    x, y = (np.array([row[name] for row in tried]) for name in (first, second))
    return Picture(
        f"Points tried: {first} and {second}",
        pictures.draw_points(x, y, score, (first, second), label),
        "The two numbers that go most with the score. Star: best; rings: within "
        f"{100 * (NEAR - 1):.0f} % of it; the other numbers vary too.",
        f"{score.size} points, coloured by {label}; best {number(float(score.min()))} at "
        f"{first} = {number(float(x[score.argmin()]))}, {second} = {number(float(y[score.argmin()]))}.",
    )
