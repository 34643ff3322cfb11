"""Options that several commands share, and how they print."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from tuning.files.errors import printable
from tuning.terminal.following import Following, sentence

if TYPE_CHECKING:
    pass

STUDY = click.argument("study", type=click.Path(path_type=Path))
SETTINGS = click.option(
    "--set", "settings", multiple=True, metavar="A.B=V", help="Replace a value of the study; repeatable."
)
JSON = click.option("--json", "as_json", is_flag=True, help="Print one JSON object for machines.")
QUIET = click.option("--quiet", "-q", is_flag=True, help="Print errors only, no progress.")
SEED = click.option("--seed", type=click.IntRange(0, 2**63 - 1), default=None, help="Replace the study's seed.")
RESUME = click.option("--resume", is_flag=True, help="Go on with an interrupted run in RUN.")
RUN = click.option(
    "-o", "--output", "folder", type=click.Path(path_type=Path), required=True, metavar="RUN", help="Run folder."
)


def with_trials(whose: str, *, least_batch: int = 1) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return the options of a search by trials: how many, and how many of them side by side."""
    trials = click.option("--trials", type=click.IntRange(min=1), default=128, show_default=True, help=whose)
    batch = click.option(
        "--batch",
        type=click.IntRange(min=least_batch),
        default=16,
        show_default=True,
        help="Trials run side by side.",
    )
    return lambda command: trials(batch(command))


def refuse_given(reason: str, *names: str) -> None:
    """Refuse options of the running command that were typed though nothing would come of them.

    Args:
        reason: why, e.g. "does not go with --dry-run".
        names: of their parameters.

    Raises:
        click.UsageError: names the first of them that was typed.
    """
    context = click.get_current_context()
    for parameter in context.command.params:
        name = parameter.name or ""
        if name in names and context.get_parameter_source(name) is not ParameterSource.DEFAULT:
            raise click.UsageError(f"{parameter.opts[0]} {reason}")


def output_file(default: str) -> Callable[[Any], Any]:
    """Return the option -o for a file."""
    return click.option(
        "-o", "--output", type=click.Path(path_type=Path), default=Path(default), show_default=True, help="File."
    )


def with_seed(settings: Sequence[str], seed: int | None) -> list[str]:
    """Return the settings, and the seed as one of them."""
    return [*settings, *([] if seed is None else [f"seed={seed}"])]


def emit(
    result: Mapping[str, Any],
    *,
    as_json: bool,
    quiet: bool,
    text: str | Callable[[], str],
    following: Following,
    comment: bool = False,
) -> None:
    """Print a result: as JSON for machines, else as text unless quiet, with the command to type next as its end.

    Args:
        result: for machines.
        as_json: whether they read it.
        quiet: print nothing for people.
        text: for people.
        following: words of the next command, which works as it stands; JSON has none.
        comment: the text is TOML, of which that line is a comment.
    """
    if as_json:
        click.echo(json.dumps(_plain(result), indent=2, allow_nan=False))
    elif not quiet:
        line = sentence(following if isinstance(following, list) else following())
        lines = (text if isinstance(text, str) else text()).split("\n")
        click.echo("\n".join(map(_without_escapes, [*lines, f"# {line}" if comment else line])))


def _without_escapes(line: str) -> str:
    """Return a line without what a terminal would obey; tabs stay."""
    return "\t".join(map(printable, line.split("\t")))


def table(headers: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Return rows as an aligned text table; what a cell holds is text, also "[deg]" or the name of a joint."""
    from rich.console import Console
    from rich.table import Column, Table
    from rich.text import Text

    shown = Table(*(Column(Text(header)) for header in headers), box=None, pad_edge=False, header_style="bold")
    for row in rows:
        shown.add_row(*(Text(f"{cell:.6g}" if isinstance(cell, float) else str(cell)) for cell in row))
    console = Console(width=240)
    with console.capture() as capture:
        console.print(shown)
    return "\n".join(line.rstrip() for line in capture.get().splitlines())


def between(low: float, high: float, form: str = ".4g") -> str:
    """Return an interval in brackets; nothing where there is none, as too few values scatter."""
    return "" if low != low or high != high else f"[{low:{form}}, {high:{form}}]"


def _plain(value: Any) -> Any:
    """Return a value as JSON can hold it: paths as text, and numbers that JSON lacks as null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    if isinstance(value, float):
        return value if value - value == 0.0 else None
    return value if isinstance(value, str | int | bool | None) else str(value)
