"""Where the work of a command is done: the options, and the executor that they ask for."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from tuning.runs.executors import Executor
    from tuning.runs.forecast import Forecast
    from tuning.study.limits import Need


def with_executor(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that `executor_for` takes."""
    executor = click.option(
        "--executor",
        type=click.Choice(["inline", "dask", "slurm"]),
        help="Where chunks are computed; dask if --workers or --scheduler is given, else inline.",
    )
    workers = click.option(
        "--workers", type=click.IntRange(min=1), help="Processes of Dask on this machine, or SLURM jobs."
    )
    scheduler = click.option("--scheduler", metavar="ADDRESS", help="A Dask scheduler that runs already.")
    wait = click.option(
        "--wait",
        type=click.FloatRange(min=0.0),
        metavar="SECONDS",
        help="Give up once --scheduler has had no workers for so long; by default never.",
    )
    return executor(workers(scheduler(wait(command))))


def machines_of(executor: str | None, workers: int | None, scheduler: str | None) -> float:
    """Return how many machines share the work that the options spread; of a scheduler's nobody knows."""
    if scheduler is not None:
        return float("inf")
    return float(workers or 1) if executor == "slurm" else 1.0


def needs_of_workers(executor: str | None, workers: int | None) -> list[Need]:
    """Return what processes on this machine need, where the options start any."""
    from tuning.scoring.needs import of_workers

    return [of_workers(workers, "--workers")] if workers and executor in {None, "dask"} else []


def executor_for(
    executor: str | None, workers: int | None, scheduler: str | None, folder: Path, wait: float | None = None
) -> Executor:
    """Return the executor that the options ask for.

    Args:
        executor: its name, if given.
        workers: how many, if given.
        scheduler: address of a Dask scheduler, if given.
        folder: the run folder, in which SLURM jobs keep their files.
        wait: how long a scheduler may be without workers [s], if given.

    Raises:
        InputError: the packages for it are not installed.
        click.UsageError: the options contradict one another.
    """
    name = executor or ("dask" if workers or scheduler is not None else "inline")
    if scheduler is not None and (name != "dask" or workers):
        raise click.UsageError(
            f"--scheduler brings its own workers: it does not go with {'--workers' if workers else name}"
        )
    if wait is not None and (scheduler is None or not math.isfinite(wait)):
        raise click.UsageError("--wait is a finite time, and needs --scheduler, whose workers are waited for")
    if name == "inline" and workers:
        raise click.UsageError("--executor inline has no --workers: leave one of them out")
    if name == "slurm" and not workers:
        raise click.UsageError("--executor slurm needs --workers, the number of jobs")
    from tuning.runs.executors import DaskExecutor, Inline, SlurmExecutor
    from tuning.runs.machine import usable_cores

    if name == "inline":
        return Inline()
    if name == "slurm":
        return SlurmExecutor(folder / "jobs", workers or 1)
    return DaskExecutor(workers or usable_cores(), scheduler, wait)


def of_forecast(forecast: Forecast) -> str:
    """Return what a run will take, as text."""
    memory, compiling, running = forecast.memory / 2**30, forecast.compile_time, forecast.run_time
    said = f"memory {memory:.2f} GiB, compile {compiling:.1f} s, run {running:.1f} s"
    return f"{forecast.chunks} chunks\n{said} (from one timed chunk; nothing written)"
