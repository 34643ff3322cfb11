"""Making recordings and running an estimator over them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from tuning.cli.following import improve
from tuning.terminal.following import Words, again, deploy, fresh, words
from tuning.terminal.options import JSON, QUIET, SEED, SETTINGS, STUDY, emit, output_file, with_seed

if TYPE_CHECKING:
    from tuning.logs.reading import RecordingTable
    from tuning.study.base import Config, Study


@click.command(epilog="Example: vsajax simulate study.toml -o rec.parquet")
@STUDY
@output_file("recording.parquet")
@click.option(
    "--scenario",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Robot of the population, or noise draw.",
)
@SETTINGS
@SEED
@JSON
@QUIET
def simulate(
    study: Path,
    output: Path,
    scenario: int,
    settings: tuple[str, ...],
    seed: int | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Simulate one recording of STUDY, with truth columns, and draw it beside the file."""
    from tuning.files.errors import InputError
    from tuning.files.whole import table_suffix
    from tuning.study.base import Timed
    from tuning.study.kinds import kind_of, lacking
    from tuning.study.loading import load_study

    own = with_seed(settings, seed)
    loaded = load_study(study, own, unused=("sweep", "tune"))
    draw = kind_of(loaded).picture
    if draw is None or not isinstance(loaded, Timed):
        raise InputError(lacking(str(study), loaded, "signals over time"))
    table_suffix(output)
    from tuning.runs.machine import start_jax
    from tuning.scoring.needs import of_recording, require_drawable
    from tuning.study.limits import require

    require(of_recording(loaded, str(study)))
    require_drawable(loaded, scenario + 1, "--scenario")
    start_jax()
    from tuning.files.whole import write_table, write_text
    from tuning.pictures.style import save
    from tuning.problem import replay
    from tuning.study.base import resolved, to_toml

    columns, substeps = replay.simulate(loaded, scenario)
    write_table(output, columns)
    robot = None
    if loaded.population.paths:
        robot = output.with_suffix(".toml")
        write_text(robot, to_toml(resolved(replay.member(loaded, scenario))))
    picture = save(draw.load()(columns, title=loaded.name), output.with_suffix(".png"))
    emit(
        {
            "recording": output,
            "picture": picture,
            "samples": len(columns["time"]),
            "substeps": substeps,
            "robot": robot,
        },
        as_json=as_json,
        quiet=quiet,
        text=f"wrote {output} ({len(columns['time'])} samples, {substeps} integration steps each) and {picture}"
        + ("" if robot is None else f"\nwrote {robot}: this robot alone, and the estimator as it was there"),
        following=lambda: _after_simulation(loaded, study, output, robot, own),
    )


def _after_simulation(study: Study, path: Path, recording: Path, robot: Path | None, settings: list[str]) -> Words:
    """Return how to estimate over what was simulated; where nothing is estimated, how to better the study."""
    from tuning.kinds.estimation.study import EstimationStudy

    if not isinstance(study, EstimationStudy):
        return improve(study, path, settings)
    estimate = fresh(recording.with_name("estimate.parquet"))
    config = words("-c", path, settings=settings) if robot is None else words("-c", robot)
    return words("estimate", recording, *config, "-o", estimate)


@click.command(epilog="Example: vsajax estimate log.csv -c best.toml --map signals.toml -o estimate.parquet")
@click.argument("recording", type=click.Path(path_type=Path))
@click.option("-c", "--config", type=click.Path(path_type=Path), required=True, help="Study or tuned config.")
@click.option("--map", "map_path", type=click.Path(path_type=Path), help="Signal map of a foreign log.")
@click.option(
    "--select", multiple=True, metavar="COLUMN=V", help="Keep only the rows with this value; repeatable."
)
@output_file("estimate.parquet")
@click.option(
    "--report", "page", type=click.Path(path_type=Path), help="Write what the log shows as one HTML file."
)
@click.option("--strict", is_flag=True, help="End with exit code 1 if something is wrong with the log.")
@SETTINGS
@JSON
@QUIET
def estimate(
    recording: Path,
    config: Path,
    map_path: Path | None,
    select: tuple[str, ...],
    output: Path,
    page: Path | None,
    strict: bool,
    settings: tuple[str, ...],
    as_json: bool,
    quiet: bool,
) -> int:
    """Run the configured estimator over RECORDING and draw the answer beside the file.

    RECORDING is CSV, Parquet, MAT, HDF5, a ROS bag or MCAP; a signal map says what its columns are.

    Where the recording has a column true_stiffness, the answer is scored against it.
    """
    from tuning.files.errors import input_error, printable
    from tuning.files.whole import table_suffix
    from tuning.kinds.estimation.study import require_regular_clock
    from tuning.logs.reading import read_recording
    from tuning.study.base import Config
    from tuning.study.loading import load_config

    chosen = {}
    for choice in select:
        column, separator, value = choice.partition("=")
        if not separator:
            raise input_error(f"--select {choice}", "is not of the form COLUMN=VALUE")
        chosen[column] = value
    loaded = load_config(config, settings, unused=("sweep", "tune"))
    table_suffix(output)
    from tuning.scoring.needs import of_fit
    from tuning.study.limits import require

    if not isinstance(loaded, Config):
        raise input_error(
            f"{config}: kind", f"got {loaded.kind!r}, which estimates nothing", "name an estimator's study"
        )
    require(of_fit(loaded.estimator, str(config)))
    table = read_recording(recording, map_path, kind=loaded.kind, select=chosen or None)
    _require_signals(loaded, table)
    require_regular_clock(loaded, table.columns["time"], table.source)
    from tuning.runs.machine import start_jax

    require(of_fit(loaded.estimator, str(config), samples=len(table.columns["time"])))
    start_jax()
    from tuning.files.whole import write_table
    from tuning.kinds.log.answer import estimate_recording
    from tuning.kinds.log.pictures import draw_estimate
    from tuning.pictures.style import save

    answer = estimate_recording(loaded, table)
    write_table(output, answer.columns)
    title = ", ".join([Path(table.source).name, *chosen.values()])
    picture = save(draw_estimate(answer, table, title=title), output.with_suffix(".png"))
    wrote = f"wrote {output} and {picture}"
    if page is not None:
        from tuning.files.whole import write_text
        from tuning.kinds.log.page import report_log

        write_text(page, report_log(answer, table, loaded, title=title).html())
        wrote = f"wrote {output}, {picture} and {page}"
    emit(
        {"estimate": output, "picture": picture, "report": page, "notes": list(table.notes), **answer.summary},
        as_json=as_json,
        quiet=quiet,
        text=lambda: "\n".join([*(f"note: {printable(note)}" for note in table.notes), *answer.sentences, wrote]),
        following=lambda: _after_estimate(output, config, settings, page, known=answer.summary["final_known"]),
    )
    return 1 if strict and answer.summary["faults"] else 0


def _after_estimate(
    output: Path, config: Path, settings: tuple[str, ...], page: Path | None, *, known: bool
) -> Words:
    """Return how to see what the log shows; after that, how to deploy an estimator that knows its stiffness."""
    if page is None:
        return again(extra=["--report", fresh(output.with_suffix(".html"))])
    return deploy(config, settings) if known else words("check", config, settings=settings)


def _require_signals(config: Config, table: RecordingTable) -> None:
    """Refuse a recording without the signals that the estimator reads, before jax is waited for."""
    from tuning.files.errors import InputError, Mistake

    fix = "record or map it, or choose another estimator.torque, deflection or basis"
    lacking = sorted(config.estimator.needs - table.columns.keys())
    if lacking:
        places = (f"{table.source}: {name}" for name in lacking)
        raise InputError(
            *(Mistake(place, "is missing, but the estimator needs this signal", fix) for place in places)
        )
