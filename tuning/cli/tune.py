"""Sweeping a grid and tuning."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tuning.cli.executors import executor_for, machines_of, needs_of_workers, of_forecast, with_executor
from tuning.cli.following import improve, use
from tuning.files.errors import printable
from tuning.terminal.following import Words, again, run_folder, words
from tuning.terminal.options import (
    JSON,
    QUIET,
    RESUME,
    RUN,
    SEED,
    SETTINGS,
    STUDY,
    between,
    emit,
    refuse_given,
    table,
    with_seed,
    with_trials,
)

if TYPE_CHECKING:
    from tuning.scoring.intervals import Judgement
    from tuning.search.blackbox import Explored
    from tuning.search.refine import Tuned
    from tuning.study.base import Study

_BLACK_BOX = ("tpe", "cmaes", "pareto")
_TRIALS, _GRADIENT = ("trials", "batch"), ("algorithm", "starts", "budget")
_USELESS = {
    "gradient": ("of tpe, cmaes and pareto", _TRIALS),
    "hybrid": ("of another method", (*_TRIALS, "budget")),
    "grid": ("of another method", (*_TRIALS, *_GRADIENT)),
    **dict.fromkeys(_BLACK_BOX, ("of gradient and hybrid", _GRADIENT)),
}
"""By method: the options that it has no use for, and whose they are."""


@click.command(epilog="Example: vsajax sweep study.toml -o runs/s --grid estimator.fit.prior_scale=log(1e-3,10,8)")
@STUDY
@RUN
@click.option(
    "--grid",
    "grids",
    multiple=True,
    metavar="A.B=AXIS",
    help="log(lo,hi,n), lin(lo,hi,n) or v1,v2; replaces the study's grid.",
)
@click.option("--scenarios", type=click.IntRange(min=1), help="Noise draws per configuration.")
@click.option(
    "--dry-run", is_flag=True, help="Time one chunk; print points, chunks, memory and time; write nothing."
)
@with_executor
@SETTINGS
@SEED
@RESUME
@JSON
@QUIET
def sweep(
    study: Path,
    folder: Path,
    grids: tuple[str, ...],
    scenarios: int | None,
    dry_run: bool,
    executor: str | None,
    workers: int | None,
    scheduler: str | None,
    wait: float | None,
    settings: tuple[str, ...],
    seed: int | None,
    resume: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Score every point of a grid over numbers of STUDY, on the same noise draws."""
    from tuning.study.loading import load_study
    from tuning.study.structures import with_grid

    loaded = load_study(study, with_seed(settings, seed))
    loaded = with_grid(loaded, grids, scenarios)
    if dry_run:
        refuse_given("does not go with --dry-run, which goes on with nothing", "resume")
    where = executor_for(executor, workers, scheduler, folder, wait)
    from tuning.runs.machine import start_jax
    from tuning.scoring.needs import of_base, of_structures, of_sweep
    from tuning.study.limits import require

    place = "--grid" if grids else f"{study}: sweep.grid"
    asked = of_sweep(loaded, place, machines=machines_of(executor, workers, scheduler))
    base = [*of_base(loaded, str(study)), *of_structures(loaded, str(study))]
    require(*base, asked, *needs_of_workers(executor, workers))
    start_jax()
    from tuning.scoring.sweep import plan_sweep, rank, say_edges, write_winner

    planned = plan_sweep(loaded, str(study))
    if dry_run:
        foreseen = planned.forecast()
        require(replace(asked, memory=foreseen.memory, seconds=foreseen.compile_time + foreseen.run_time))
        emit(
            {"configurations": planned.configurations, "scenarios": planned.scenarios} | asdict(foreseen),
            as_json=as_json,
            quiet=quiet,
            text=f"{planned.configurations} configurations × {planned.scenarios} scenarios, "
            f"{of_forecast(foreseen)}",
            following=lambda: again(without="--dry-run"),
        )
        return
    store = planned.open(folder, resume=resume)
    results = planned.run(store, where, quiet=quiet)
    objective = loaded.tune.objective
    rows = rank(results, list(planned.axes), objective)
    # Half a second, which the first result need not wait for.
    from tuning.pictures.style import save
    from tuning.report.pictures.searches import draw_sweep

    picture = save(draw_sweep(rows, planned.axes, objective), folder / "figures" / "sweep.png")
    best = write_winner(planned, rows[0], folder / "best.toml")
    told = {"run": folder, "results": folder / "results.parquet", "picture": picture}
    edges = say_edges(planned.axes, rows[0])
    # Of one scenario the three are one.
    shown = [name for name in rows[0] if planned.scenarios > 1 or name not in {"median", "q90"}]
    emit(
        told | {"winner": best, "best": rows[:10], "edges": edges},
        as_json=as_json,
        quiet=quiet,
        text=lambda: "\n".join(
            [
                f"{len(rows)} configurations × {planned.scenarios} scenarios; best by mean {objective}:"
                if planned.scenarios > 1
                else f"{len(rows)} configurations; best by {objective}:",
                table(shown, [[row[name] for name in shown] for row in rows[:5]]),
                *(f"WARNING: {edge}" for edge in edges),
                f"wrote {'' if best is None else f'{best}, '}{folder / 'results.parquet'} and {picture}",
            ]
        ),
        following=lambda: words("check", study) if best is None else _after_sweep(loaded, best),
    )


def _after_sweep(study: Study, best: Path) -> Words:
    """Return how to go on from a sweep's winner: tune it, run it over its population, or see the report."""
    following = improve(study, best, beside=best.parent)
    return following if following[0] != "export" else words("report", best.parent)


@click.command(epilog="Example: vsajax tune study.toml -o runs/t --method gradient")
@STUDY
@RUN
@click.option(
    "--method",
    type=click.Choice(["gradient", "grid", "hybrid", *_BLACK_BOX]),
    default="gradient",
    show_default=True,
    help="How; the last three make the study's choices too.",
)
@click.option(
    "--algorithm",
    type=click.Choice(["levenberg-marquardt", "bfgs"]),
    default="levenberg-marquardt",
    show_default=True,
    help="Of the gradient.",
)
@click.option(
    "--starts", type=click.IntRange(min=1), help="Starts of the gradient; the first is the study itself."
)
@click.option("--budget", type=click.IntRange(min=0), help="Points screened before the gradient starts.")
@with_trials("Of tpe, cmaes or pareto.")
@SETTINGS
@SEED
@RESUME
@JSON
@QUIET
def tune(
    study: Path,
    folder: Path,
    method: Any,
    algorithm: Any,
    starts: int | None,
    budget: int | None,
    trials: int,
    batch: int,
    settings: tuple[str, ...],
    seed: int | None,
    resume: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Find the best numbers of STUDY; write RUN/best.toml with its scores on held-out noise.

    A STUDY with a [recording] is tuned on a part of that log, and judged by the rest of it.
    """
    from tuning.study.loading import load_study

    own = [*settings]
    own += [] if starts is None else [f"tune.starts={starts}"]
    own += [] if budget is None else [f"tune.screen={budget}"]
    refuse_given(f"does not go with --method {method}: it is {_USELESS[method][0]}", *_USELESS[method][1])
    loaded = load_study(study, with_seed(own, seed))
    from tuning.runs.machine import start_jax
    from tuning.scoring.needs import of_base, of_gradient, of_grid_search, of_held_out, of_trials
    from tuning.study.limits import require

    if method in _BLACK_BOX:
        asked = of_trials(loaded, trials, batch, "--trials and --batch")
    elif method == "gradient":
        asked = of_gradient(loaded, f"{study}: tune")
    else:
        asked = of_grid_search(loaded, f"{study}: tune.parameters", refines=method == "hybrid")
    require(*of_base(loaded, str(study)), asked, of_held_out(loaded, 2, f"{study}: scenarios.held_out"))
    start_jax()
    if method in _BLACK_BOX:
        from tuning.search.blackbox import explore, plan_blackbox

        box = plan_blackbox(loaded, method, batch, str(study))
        explored = explore(box, folder, trials=trials, resume=resume, quiet=quiet)
        report, lines = _explored(explored, method, loaded, folder)
        tuned = explored.tuned
    else:
        from tuning.search.refine import plan_search
        from tuning.search.refine import tune as run_tuning

        search = plan_search(loaded, method, algorithm, str(study))
        tuned = run_tuning(search, folder, resume=resume, quiet=quiet)
        tell = _gridded if method == "grid" else _refined
        report, lines = tell(tuned, search.paths, loaded.tune.objective)
    from tuning.pictures.style import save
    from tuning.problem.finding import joined
    from tuning.report.pictures.searches import draw_search
    from tuning.runs.folder import read_results
    from tuning.runs.sealed import columns_of
    from tuning.study.scores import unit_of

    each = {"before": tuned.before.each, "tuned": tuned.held_out.each}
    drawn = draw_search(each, columns_of(read_results(folder)), sorted(tuned.values), loaded.tune.objective)
    picture = save(drawn, folder / "figures" / "tuning.png")
    finding = tuned.finding
    result = {
        "run": folder,
        "best": folder / "best.toml",
        "picture": picture,
        "method": method,
        "values": tuned.values,
        "calibration": dict(tuned.calibration),
        "objective": tuned.objective,
        "messages": tuned.messages,
        **report,
        "evaluations": tuned.evaluations,
        "seconds": tuned.seconds,
        "train": tuned.train.summary(),
        "held_out": tuned.held_out.summary(),
        "before_on_held_out": tuned.before.summary(),
    }

    def text() -> str:
        unit = unit_of(loaded.tune.objective)
        judged = [
            f"{name:<28} {j.value:.4g}{unit}  {between(j.low, j.high) or '–'}"
            + (f"  median {j.median:.4g}{unit}" if j.scenarios > 1 else "")
            + ("" if j.msrep_mean is None else f"  msrep {j.msrep_mean:.4g} %")
            + (
                f"  settled {j.settled_mean:.2g} %"
                if j.settled_mean is not None and j.settled_mean == j.settled_mean
                else ""
            )
            + _held(j)
            + ("" if j.convergence_time is None else f"  converged in {j.convergence_time:.3f} s")
            for name, j in (
                (f"before, {_many(tuned.before)}held out:", tuned.before),
                (f"tuned, {_many(tuned.train)}training:", tuned.train),
                (f"tuned, {_many(tuned.held_out)}held out:", tuned.held_out),
            )
        ]
        cost = f"{tuned.evaluations} evaluations in {tuned.seconds:.1f} s"
        notes = [f"note: {printable(note)}" for note in finding.notes]
        found = [] if finding.table is None else [table(finding.table.headers, finding.table.rows)]
        wrote = f"wrote {folder / 'best.toml'}, {folder / 'results.parquet'} and {picture}"
        return "\n".join([*notes, *lines, *judged, *found, *finding.sentences, cost, wrote])

    def following() -> Words:
        if method == "pareto":
            return words("report", folder)
        if loaded.population.paths:
            return words("montecarlo", folder / "best.toml", "-o", run_folder("montecarlo", folder))
        return use(loaded, folder / "best.toml")

    emit(joined(result, finding.facts), as_json=as_json, quiet=quiet, text=text, following=following)


def _held(judgement: Judgement) -> str:
    """Return how often the truth was inside the band, where there is one and a truth."""
    if judgement.coverage is None:
        return ""
    if judgement.coverage != judgement.coverage:
        return "  never known"
    ends = between(100.0 * (judgement.coverage_low or math.nan), 100.0 * (judgement.coverage_high or math.nan))
    return f"  inside the band {100.0 * judgement.coverage:.1f} %{ends and f' {ends}'}"


def _many(judgement: Judgement) -> str:
    """Return how many scenarios were judged, where it is more than the one that a recording is."""
    return f"{judgement.scenarios} " if judgement.scenarios > 1 else ""


def _refined(tuned: Tuned, paths: tuple[str, ...], objective: str) -> tuple[dict[str, Any], list[str]]:
    """Return what is reported of the starts of a gradient, for machines and for people."""
    from tuning.study.scores import unit_of

    headers = [
        "start",
        *(p.removeprefix("estimator.") for p in paths),
        f"train {objective}{unit_of(objective)}",
        "steps",
        "ended",
    ]
    rows = [[i, *o.values.values(), o.objective, o.steps, o.message] for i, o in enumerate(tuned.outcomes)]
    return {"starts": [asdict(outcome) for outcome in tuned.outcomes]}, [table(headers, rows)]


def _gridded(tuned: Tuned, paths: tuple[str, ...], objective: str) -> tuple[dict[str, Any], list[str]]:
    """Return what is reported of the points of a grid, for machines and for people."""
    from tuning.study.scores import unit_of

    headers = ["", *(p.removeprefix("estimator.") for p in paths), f"train {objective}{unit_of(objective)}"]
    rows = [[n + 1, *values.values(), score] for n, (score, values) in enumerate(tuned.screened[:5])]
    points = [values | {"objective": score} for score, values in tuned.screened]
    return {"points": points}, [f"the best of {tuned.evaluations} points:", table(headers, rows)]


def _explored(explored: Explored, method: str, study: Study, folder: Path) -> tuple[dict[str, Any], list[str]]:
    """Return what is reported of the trials of a black-box search, for machines and for people."""
    from tuning.pictures.style import save
    from tuning.report.pictures.fronts import draw_front

    report = {"choices": explored.best.chosen, "trials": len(explored.trials), "failed": explored.failed}
    rows = [trial.row() for trial in explored.front]
    headers = list(dict.fromkeys(name for row in rows for name in row))
    names = [name.removeprefix("estimator.").removeprefix("choices.") for name in headers]
    lines = [
        table(names, [[row.get(name, "") for name in headers] for row in rows]),
        f"{len(explored.trials)} trials, {explored.failed} of them without a finite score",
    ]
    if method == "pareto":
        front = draw_front(explored.trials, explored.front, study.tune.objective)
        report |= {"front": rows, "front_picture": save(front, folder / "figures" / "pareto.png")}
    return report, lines
