"""Progress with an estimate of the time left, on stderr, for people at a terminal only."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol


class Advance(Protocol):
    """Tells that some of the work is done."""

    def __call__(self, amount: float = 1.0) -> None: ...  # noqa: D102


@contextmanager
def progress(title: str, total: float, *, quiet: bool = False) -> Iterator[Advance]:
    """Show a bar while the block runs; yields the function that advances it."""
    if quiet or not sys.stderr.isatty():
        yield lambda amount=1.0: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn
    from rich.progress import TimeRemainingColumn as Remaining

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
        Remaining(),
    )
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task(title, total=total)
        yield lambda amount=1.0: bar.advance(task, amount)
