"""Options that several commands share, and how they print."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import click

STUDY = click.argument("study", type=click.Path(path_type=Path))
SETTINGS = click.option(
    "--set", "settings", multiple=True, metavar="A.B=V", help="Replace a value of the study; repeatable."
)
JSON = click.option("--json", "as_json", is_flag=True, help="Print one JSON object for machines.")
QUIET = click.option("--quiet", "-q", is_flag=True, help="Print errors only, no progress.")
SEED = click.option("--seed", type=click.IntRange(min=0), default=None, help="Replace the study's seed.")
RESUME = click.option("--resume", is_flag=True, help="Go on with an interrupted run in RUN.")
RUN = click.option(
    "-o", "--output", "folder", type=click.Path(path_type=Path), required=True, metavar="RUN", help="Run folder."
)


def output_file(default: str) -> Callable[[Any], Any]:
    """Return the option -o for a file."""
    return click.option(
        "-o", "--output", type=click.Path(path_type=Path), default=Path(default), show_default=True, help="File."
    )


def with_seed(settings: Sequence[str], seed: int | None) -> list[str]:
    """Return the settings, and the seed as one of them."""
    return [*settings, *([] if seed is None else [f"seed={seed}"])]


def emit(result: Mapping[str, Any], *, as_json: bool, quiet: bool, text: str | Callable[[], str]) -> None:
    """Print a result: as JSON for machines, else as text unless quiet."""
    if as_json:
        click.echo(json.dumps(_plain(result), indent=2, allow_nan=False))
    elif not quiet:
        click.echo(text if isinstance(text, str) else text())


def table(headers: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Return rows as an aligned text table."""
    from rich.console import Console
    from rich.table import Table

    shown = Table(*headers, box=None, pad_edge=False, header_style="bold")
    for row in rows:
        shown.add_row(*(f"{cell:.6g}" if isinstance(cell, float) else str(cell) for cell in row))
    console = Console(width=240)
    with console.capture() as capture:
        console.print(shown)
    return "\n".join(line.rstrip() for line in capture.get().splitlines())


def _plain(value: Any) -> Any:
    """Return a value as JSON can hold it: paths as text, and numbers that JSON lacks as null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    if isinstance(value, float):
        return value if value - value == 0.0 else None
    return value if isinstance(value, str | int | bool | None) else str(value)
