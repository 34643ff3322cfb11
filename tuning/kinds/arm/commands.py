"""The Cartesian stiffness of arms: one pose, a workspace, better poses, what accuracy costs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tuning.terminal.following import run_folder, words
from tuning.terminal.options import JSON, QUIET, RUN, SEED, SETTINGS, STUDY, emit, table, with_seed

if TYPE_CHECKING:
    from tuning.kinds.arm.bench import ArmBench
    from tuning.kinds.arm.study import ArmStudy
    from tuning.study.limits import Need


def _open(
    path: Path,
    settings: tuple[str, ...],
    seed: int | None,
    needs: Callable[[ArmStudy, str], Sequence[Need]] | None = None,
    *,
    folder: Path | None = None,
) -> tuple[ArmStudy, ArmBench]:
    from tuning.kinds.arm.study import load_arm_study
    from tuning.study.limits import require

    study = load_arm_study(path, with_seed(settings, seed))
    require(*(needs(study, str(path)) if needs else ()))
    if folder is not None:
        from tuning.kinds.arm.run import require_folder

        command = click.get_current_context().info_name or ""
        require_folder(folder, command)
    from tuning.runs.machine import start_jax

    start_jax()
    from tuning.kinds.arm.bench import build_bench

    return study, build_bench(study, path)


def _end(*, ok: bool) -> None:
    if not ok:
        raise click.exceptions.Exit(1)


def _percent(value: float | None) -> str:
    return "–" if value is None or value != value else f"{100.0 * value:.4g} %"


@click.command(epilog="Example: vsajax stiffness arm.toml --set arm.pose_deg=[30,-20,10,90]")
@STUDY
@click.option(
    "-o",
    "--output",
    "folder",
    type=click.Path(path_type=Path),
    metavar="RUN",
    help="Keep it, with a picture, in this run folder.",
)
@SETTINGS
@JSON
@QUIET
def stiffness(study: Path, folder: Path | None, settings: tuple[str, ...], as_json: bool, quiet: bool) -> None:
    """Design joints and controller for the pose of STUDY; exit 1 where the pose allows no design that meets it."""
    loaded, bench = _open(study, settings, None, folder=folder)
    from tuning.kinds.arm.design import design_pose

    result = design_pose(loaded, bench, loaded.notes())
    files, told = [], result.as_tables()
    if folder is not None:
        from tuning.kinds.arm.figures import draw_pose
        from tuning.kinds.arm.run import write_run
        from tuning.pictures.style import save

        files = write_run(folder, "stiffness", loaded, told)
        files.append(save(draw_pose(loaded, told), folder / "stiffness.png"))
        told = {"run": folder, "files": files} | told
    following = words("workspace", study, "-o", run_folder("workspace", folder), settings=settings)
    emit(
        told,
        as_json=as_json,
        quiet=quiet,
        text=lambda: "\n".join([result.as_text(), *(f"wrote {file}" for file in files)]),
        following=following,
    )
    _end(ok=result.ok)


@click.command(epilog="Example: vsajax workspace arm.toml -o runs/workspace")
@STUDY
@RUN
@SETTINGS
@SEED
@JSON
@QUIET
def workspace(
    study: Path, folder: Path, settings: tuple[str, ...], seed: int | None, as_json: bool, quiet: bool
) -> None:
    """Map the stiffness that the arm of STUDY can have over its workspace."""
    from tuning.kinds.arm.needs import of_workspace

    loaded, bench = _open(study, settings, seed, of_workspace, folder=folder)
    from tuning.kinds.arm.workspace import map_workspace, write_workspace

    columns, summary = map_workspace(loaded, bench)
    files = write_workspace(loaded, columns, folder, summary)

    def text() -> str:
        rows = [
            [name.replace("_", " "), *(_percent(value) for value in quantiles.values())]
            for name, quantiles in summary["quantiles"].items()
            if any(value is not None for value in quantiles.values())
        ]
        counted = ", ".join(f"{count} {name}" for name, count in summary["statuses"].items() if count)
        return "\n".join(
            [
                *([table(["relative error", "10 %", "median", "90 %"], rows)] if rows else []),
                f"{summary['poses']} poses in {summary['seconds']:.1f} s: {counted}",
                f"the desired stiffness is met exactly in {100.0 * summary['exact_share']:.1f} % of them",
                *([] if summary["ok"] else [f"no pose has a design that can be used: {summary['meaning']}"]),
                *(f"wrote {file}" for file in files),
            ]
        )

    following = words("poses", study, "-o", run_folder("poses", folder), settings=settings)
    emit({"run": folder, "files": files} | summary, as_json=as_json, quiet=quiet, text=text, following=following)
    _end(ok=summary["ok"])


@click.command(epilog="Example: vsajax poses arm.toml -o runs/poses")
@STUDY
@RUN
@SETTINGS
@SEED
@JSON
@QUIET
def poses(
    study: Path, folder: Path, settings: tuple[str, ...], seed: int | None, as_json: bool, quiet: bool
) -> None:
    """Search poses with the hand where it is whose joints alone fit the stiffness better."""
    from tuning.kinds.arm.needs import of_poses

    loaded, bench = _open(study, settings, seed, of_poses, folder=folder)
    from tuning.kinds.arm.poses import improve_poses, write_poses
    from tuning.terminal.progress import progress

    with progress("poses", loaded.poses.starts, quiet=quiet or as_json) as advance:
        columns, summary = improve_poses(loaded, bench, advance)
    files = write_poses(loaded, columns, folder, summary)

    def text() -> str:
        rows = [[name, _percent(value)] for name, value in summary["median_error"].items() if value is not None]
        return "\n".join(
            [
                *([table(["median over targets of the passive compliance error", ""], rows)] if rows else []),
                f"{summary['targets']} targets, {summary['starts']} starts, {summary['seconds']:.1f} s; "
                f"hand held to {summary['largest_shift']:.1e} m",
                *([_unreached(summary)] if summary["unreached"] else []),
                *(f"wrote {file}" for file in files),
            ]
        )

    following = words("montecarlo", study, "-o", run_folder("montecarlo", folder), settings=settings)
    emit({"run": folder, "files": files} | summary, as_json=as_json, quiet=quiet, text=text, following=following)
    _end(ok=summary["ok"])


def _unreached(summary: Mapping[str, Any]) -> str:
    lost = "no target" if not summary["ok"] else f"{summary['unreached']} of {summary['targets']} targets"
    if summary["ok"]:
        return f"{lost} have no start whose error has a value: they are left out"
    return f"{lost} has a pose whose passive error has a value: `vsajax stiffness` says why for one of them"
