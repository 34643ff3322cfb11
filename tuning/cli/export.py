"""Exporting tuned configurations, and checking what was exported."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tuning.cli.plugins import OpenChoice
from tuning.terminal.following import Words, words
from tuning.terminal.options import JSON, QUIET, SETTINGS, emit, refuse_given

if TYPE_CHECKING:
    from tuning.exports.recheck import Exported
    from tuning.study.registry import Registry


def _formats() -> Registry[Any]:
    from tuning.exports.formats.registry import FORMATS

    return FORMATS


@click.command(epilog="Example: vsajax export runs/t/best.toml --to c99 -o deploy --check")
@click.argument("config", type=click.Path(path_type=Path))
@click.option("--to", "target", type=OpenChoice(_formats), help="Format.")
@click.option("-o", "--output", "folder", type=click.Path(path_type=Path), help="Folder.")
@click.option("--check", "thorough", is_flag=True, help="Run every check; alone, those of an exported folder.")
@click.option(
    "--recording", type=click.Path(path_type=Path), help="Golden recording, in place of a simulated one."
)
@click.option(
    "--duration",
    type=click.FloatRange(min=0.01),
    default=10.0,
    show_default=True,
    help="Of the simulated one [s].",
)
@click.option("--trust", is_flag=True, help="Run the folder's own check.py, even if it is not that of vsajax.")
@click.option(
    "--name",
    help="Prefix of all that is generated, instead of the study's name: two exports in one program need two.",
)
@SETTINGS
@JSON
@QUIET
def export(
    config: Path,
    target: str | None,
    folder: Path | None,
    thorough: bool,
    recording: Path | None,
    duration: float,
    trust: bool,
    name: str | None,
    settings: tuple[str, ...],
    as_json: bool,
    quiet: bool,
) -> None:
    """Export a tuned CONFIG with manifest, golden recording and a check that is run; exit 1 if it fails.

    With --check and no format, CONFIG is a folder that was exported, and its checks are run again: by the scripts
    of vsajax, never by its own unless they are the same or --trust is given.
    """
    if target is None and folder is None and thorough:
        refuse_given(
            "does not go with the check of an exported folder", "recording", "duration", "name", "settings"
        )
        from tuning.exports.recheck import check_folder

        _tell(check_folder(config, trusted=trust), None, as_json=as_json, quiet=quiet)
        return
    refuse_given("is for the check of an exported folder", "trust")
    if target is None:
        raise click.MissingParameter(param_hint="'--to'", param_type="option")
    if folder is None:
        raise click.MissingParameter(param_hint="'-o' / '--output'", param_type="option")
    from tuning.study.kinds import exported_files
    from tuning.study.loading import load

    # Mistakes are told before jax is waited for.
    if name is not None:
        from tuning.exports.names import checked_name

        checked_name(name, "--name")
    loaded = load(config, settings, *exported_files(), unused=("sweep", "tune"))
    if recording is not None:
        refuse_given("does not go with --recording, which has a length of its own", "duration")
    from tuning.runs.machine import start_jax
    from tuning.scoring.needs import of_export
    from tuning.study.limits import require

    require(*of_export(loaded, 0.0 if recording else duration, str(config), "--duration"))

    start_jax()
    from tuning.exports.export import export_config

    exported = export_config(
        config,
        target,
        folder,
        settings=settings,
        seconds=duration,
        recording=recording,
        thorough=thorough,
        name=name,
    )
    _tell(exported, None if thorough else folder, as_json=as_json, quiet=quiet)


def _tell(exported: Exported, unchecked: Path | None, *, as_json: bool, quiet: bool) -> None:
    lines = [f"wrote {path}" for path in exported.written]
    lines += [f"{result['state']:8} {result['name']}: {result['what']}" for result in exported.results]
    result = {"ok": exported.ok, "files": [str(path) for path in exported.written], "checks": exported.results}
    emit(
        result,
        as_json=as_json,
        quiet=quiet,
        text="\n".join(lines),
        following=lambda: _following(exported, unchecked),
    )
    if not exported.ok:
        raise click.exceptions.Exit(1)


def _following(exported: Exported, unchecked: Path | None) -> Words:
    """Return the whole check of a folder; after it, what else ships, or what the check ran on if it failed."""
    if unchecked is not None:
        return words("export", unchecked, "--check")
    return words("init", "--list") if exported.ok else words("doctor")
