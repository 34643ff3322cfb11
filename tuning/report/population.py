"""The report on a Monte Carlo run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from tuning.pictures.page import Picture, number
from tuning.problem.interface import Status
from tuning.report import tables
from tuning.report.elements import SHOWN, Parts, medians_of, show_causes, show_over_time
from tuning.report.gather import FinishedRun
from tuning.report.pictures import scores as pictures
from tuning.report.pictures.populations import draw_influences, draw_spread
from tuning.report.pictures.scores import short_paths, short_rows
from tuning.scoring.summary import has_failed
from tuning.scoring.told import Told
from tuning.study.kinds import kind_of
from tuning.study.scores import title_of, unit_of


def describe_population(run: FinishedRun) -> Parts:
    """Return what there is to say of a population, in the words of its kind where that has its own."""
    own = kind_of(run.study).told
    if own is not None:
        told: Told = own.load()(run.study, run.columns)
        return Parts(told.headline, iter([told.picture()]), [told.table()], run.study.notes())
    summary, definitions = run.summary, run.study.population.failures
    first, *rest = summary.sentences
    failing = [one for one in rest if any(one.startswith(f"{name} (") for name in summary.failures)]
    sentences = [f"{summary.scenarios} robots: {first}", *(["; ".join(failing)] if failing else [])]
    found = [
        tables.tabulate_quantiles(summary),
        tables.tabulate_failures(summary, definitions),
        tables.tabulate_influences(summary, run.objective),
    ]
    return Parts(
        headline=" ".join(f"{sentence[0].upper()}{sentence[1:]}." for sentence in sentences),
        pictures=_population_pictures(run),
        tables=[table for table in found if table.rows],
        findings=[*(one for one in rest if one not in failing), *_what_to_do(summary.advice)],
    )


def _what_to_do(advice: list[str]) -> list[str]:
    """Return the advice on each failure as one finding."""
    found: list[str] = []
    for line in advice:
        if line.startswith(" ") and found:
            found[-1] += f"; {line.strip()}"
        else:
            found.append(f"What to do: {line}")
    return found


def _population_pictures(run: FinishedRun) -> Iterator[Picture]:
    summary, objective, paths = run.summary, run.objective, run.study.population.paths
    columns, counted = run.columns, run.columns["status"] == Status.OK
    shown = min(SHOWN, counted.size)
    titles = [_case_title(columns, scenario, objective) for scenario in summary.worst]
    cases = dict(zip(summary.worst, titles, strict=True))
    yield from show_over_time(run.study, run.stream, range(shown), cases=cases)
    rows = {name: values[counted] for name, values in columns.items()}
    q = summary.quantiles[objective]
    yield Picture(
        "How the scores are spread",
        draw_spread(rows, run.study, summary, across=1),
        f"{int(counted.sum())} of {counted.size} robots have scores.",
        f"Distribution of {title_of(objective)} and of the convergence time; "
        f"median {number(q[0.5].value)}, 95 % quantile {number(q[0.95].value)}.",
    )
    if summary.influences:
        ranked = sorted(summary.influences.items(), key=lambda item: -item[1].total.value)
        yield Picture(
            "What moves the score",
            draw_influences(replace(summary, influences=_short_keys(dict(ranked))), objective),
            "Sobol indices. The sum of those with interactions may exceed 100 %.",
            "Bars: "
            + ", ".join(f"{name} {100 * i.total.value:.0f} %" for name, i in ranked)
            + ", with interactions.",
        )
    if paths:
        yield show_causes(*short_rows(rows, paths), objective)
    if summary.failures or not counted.all():
        yield _by_failure(run)


def _short_keys(table: dict[str, Any]) -> dict[str, Any]:
    return dict(zip(short_paths(list(table)), table.values(), strict=True))


def _case_title(columns: dict[str, np.ndarray], scenario: int, objective: str) -> str:
    (row,) = np.flatnonzero(columns["scenario"] == scenario)
    status = Status(int(columns["status"][row]))
    score = (
        f"{objective} {number(float(columns[objective][row]))}{unit_of(objective)}"
        if status == Status.OK
        else status.reason
    )
    return f"robot {scenario}: {score}"


def _by_failure(run: FinishedRun) -> Picture:
    columns, objective = run.columns, run.objective
    status = columns["status"]
    scores = np.where(status == Status.OK, columns[objective], np.nan)
    groups = {"all": scores}
    for name, text in run.study.population.failures.items():
        failed = has_failed(columns, name, text)
        groups |= {f"{name}: fails": scores[failed], f"{name}: holds": scores[~failed]}
    groups |= {s.reason: scores[status == s] for s in Status if s != Status.OK and np.any(status == s)}
    groups = {name: values for name, values in groups.items() if values.size}
    return Picture(
        "Scores by failure and ending",
        pictures.draw_shares(groups, objective),
        "In brackets: robots. A curve ends below 100 % by the share that has no finite score.",
        f"Distributions of {title_of(objective)} by group: {medians_of(groups)}.",
    )
