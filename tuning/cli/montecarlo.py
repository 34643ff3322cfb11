"""Monte Carlo runs over a population of robots."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tuning.cli.executors import executor_for, machines_of, needs_of_workers, of_forecast, with_executor
from tuning.terminal.following import again, words
from tuning.terminal.options import (
    JSON,
    QUIET,
    RESUME,
    RUN,
    SEED,
    SETTINGS,
    STUDY,
    emit,
    refuse_given,
    table,
    with_seed,
)

if TYPE_CHECKING:
    from tuning.scoring.summary import Interval, Summary
    from tuning.scoring.told import Told


@click.command(epilog="Example: vsajax montecarlo serial-population.toml -o runs/population --scenarios 20000")
@STUDY
@RUN
@click.option(
    "--scenarios",
    type=click.IntRange(min=2),
    help="Robots, by default 4096; of an arm, draws at each level, by default accuracy.draws.",
)
@click.option(
    "--precision",
    type=click.FloatRange(min=0.0, min_open=True),
    help="Stop once the 95 % quantile's interval is within this share of it.",
)
@click.option(
    "--sensitivity",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Rows of a design for Sobol indices, a power of two; each costs factors + 3 scenarios.",
)
@click.option(
    "--target",
    type=click.FloatRange(min=0.0, max=1.0, min_open=True, max_open=True),
    default=0.05,
    show_default=True,
    help="Share of the robots that may fail: what to do is said about failures beyond it.",
)
@click.option("--worst", type=click.IntRange(min=0), default=5, show_default=True, help="Worst cases to list.")
@click.option("--dry-run", is_flag=True, help="Time one chunk; print chunks, memory and time; write nothing.")
@with_executor
@SETTINGS
@SEED
@RESUME
@JSON
@QUIET
def montecarlo(
    study: Path,
    folder: Path,
    scenarios: int | None,
    precision: float | None,
    sensitivity: int,
    target: float,
    worst: int,
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
    """Score the estimator of STUDY over its [population]: quantiles, failure probabilities, what matters.

    For an arm: what an error in its joints' stiffness costs at the hand.
    """
    from tuning.files.errors import InputError, input_error
    from tuning.study.kinds import kind_of, lacking
    from tuning.study.loading import load_study

    loaded = load_study(study, with_seed(settings, seed), unused=["sweep"])
    if because := loaded.no_scenarios():
        raise InputError(lacking(str(study), loaded, f"scenarios to draw ({because})"))
    own = kind_of(loaded).told
    if own is not None:
        why = f"does not go with kind {loaded.kind!r}, whose robots are not summed up as one population"
        refuse_given(why, "precision", "sensitivity", "target", "worst")
    count = loaded.robots(scenarios)
    if sensitivity & (sensitivity - 1):
        below = 1 << (sensitivity.bit_length() - 1)
        raise input_error("--sensitivity", f"got {sensitivity}", f"allowed: powers of two, e.g. {below}")
    if dry_run:
        refuse_given("does not go with --dry-run, which scores nothing", "resume", "worst", "target", "precision")
    from tuning.runs.machine import start_jax
    from tuning.scoring.needs import of_base, of_design, of_population, require_drawable
    from tuning.study.limits import require

    machines = machines_of(executor, workers, scheduler)
    asked = [of_population(loaded, count, "--scenarios", machines=machines)]
    asked += [of_design(loaded, sensitivity, "--sensitivity", machines=machines)] if sensitivity else []
    require(*of_base(loaded, str(study)), *asked, *needs_of_workers(executor, workers))
    require_drawable(loaded, count, "--scenarios")
    start_jax()
    from tuning.scoring.montecarlo import MonteCarlo, compute_population, run_population

    run, design = MonteCarlo(loaded, count), MonteCarlo(loaded, count, sensitivity)
    if dry_run:
        extra = f" and {design.size} of the design" if sensitivity else ""
        foreseen = run.forecast()
        if sensitivity:
            whole = foreseen.run_time * (1.0 + len(design.chunks) / len(run.chunks))
            foreseen = replace(foreseen, run_time=whole)
        require(replace(asked[0], memory=foreseen.memory, seconds=foreseen.compile_time + foreseen.run_time))
        emit(
            {"scenarios": run.size} | asdict(foreseen),
            as_json=as_json,
            quiet=quiet,
            text=f"{count} robots{extra}, {of_forecast(foreseen)}",
            following=lambda: again(without="--dry-run"),
        )
        return
    where = executor_for(executor, workers, scheduler, folder, wait)
    if own is not None:
        columns = compute_population(run, folder, where, resume=resume, quiet=quiet)
        _tell(own.load()(loaded, columns), folder, as_json=as_json, quiet=quiet)
        return
    from tuning.report.pictures.populations import draw_population
    from tuning.scoring.summary import write_summary

    summary = run_population(
        run,
        folder,
        where,
        rows=sensitivity,
        precision=precision,
        worst=worst,
        target=target,
        resume=resume,
        quiet=quiet,
    )
    write_summary(summary, folder / "summary.json")
    pictures = draw_population(folder, loaded, summary)
    emit(
        {"run": folder, "results": folder / "results.parquet", "pictures": pictures} | summary.as_tables(),
        as_json=as_json,
        quiet=quiet,
        text=lambda: _text(
            summary,
            study,
            folder,
            loaded.tune.objective,
            pictures,
            has_signals=kind_of(loaded).picture is not None,
        ),
        following=words("report", folder),
    )


def _tell(told: Told, folder: Path, *, as_json: bool, quiet: bool) -> None:
    """Print what a kind says of its run in its own words; exit 1 where no scenario has a score."""
    from tuning.pictures.style import save

    results = folder / "results.parquet"
    picture = save(told.picture().figure, folder / f"{told.picture_name}.png")
    files = [folder / "manifest.json", results, picture]
    emit(
        {"run": folder, "results": results, "pictures": [picture], "files": files} | dict(told.as_tables()),
        as_json=as_json,
        quiet=quiet,
        text=lambda: f"{told.as_text()}\nwrote {results} and {picture}",
        following=words("report", folder),
    )
    if not told.is_ok:
        raise click.exceptions.Exit(1)


def _bracketed(unit: str) -> str:
    return f" [{unit}]" if unit else ""


def _quantile(q: Interval) -> str:
    """Return a quantile with its interval; a time that never comes is infinite."""
    finite = [end for end in (q.low, q.high) if abs(end) < float("inf")]
    ends = f" [{_number(q.low)}, {_number(q.high)}]" if finite and q.low != q.high else ""
    return f"{_number(q.value)}{ends}"


def _number(value: float) -> str:
    if value != value:
        return "–"
    return f"{value:.4g}" if abs(value) != float("inf") else "never"


def _text(
    summary: Summary, study: Path, folder: Path, objective: str, pictures: list[Any], *, has_signals: bool
) -> str:
    from tuning.study.scores import SCORES

    levels = list(next(iter(summary.quantiles.values())))
    rows = [
        [f"{metric}{_bracketed(SCORES[metric].unit)}", *map(_quantile, quantiles.values())]
        for metric, quantiles in summary.quantiles.items()
        if SCORES[metric].is_shown
        if any(q.value == q.value for q in quantiles.values())
    ]
    lines = [
        f"{summary.scenarios} robots; quantiles with their 95 % intervals:",
        table(["metric", *(f"{100 * level:g} %" for level in levels)], rows),
        *summary.sentences,
    ]
    if summary.advice:
        lines += ["what to do:", *(f"  {line}" for line in summary.advice)]
    if summary.worst:
        numbers = ", ".join(map(str, summary.worst))
        replay = f"; replay one: vsajax simulate {study} --scenario {summary.worst[0]}" if has_signals else ""
        lines.append(f"worst by {objective}: {numbers}{replay}")
    return "\n".join(
        [*lines, f"wrote {folder / 'results.parquet'}, summary.json and {', '.join(map(str, pictures))}"]
    )
