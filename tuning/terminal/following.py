"""The command to type next, with which every command ends. Nothing here imports jax.

A next command is a list of words that works as it stands: files that are there, folders that are not.
"""

from __future__ import annotations

import itertools
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    pass

if TYPE_CHECKING:
    pass

Words = list[str]
CONSENTED = "vsajax.plugins"
"""Of the modules that `--plugin` named, in the meta data of the command's context."""
_READ_NO_STUDY = {"init", "schema", "parts", "bench", "doctor"}


def words(*parts: object, settings: Sequence[str] = ()) -> Words:
    """Return a command's words, and `--set` for each of the settings that the command before it was given."""
    return [*map(str, parts), *itertools.chain.from_iterable(("--set", setting) for setting in settings)]


def sentence(following: Words) -> str:
    """Return the line that says what to type next, quoted for a shell; with this command's own `--plugin`."""
    context = click.get_current_context(silent=True)
    modules = () if context is None else context.meta.get(CONSENTED, ())
    if "--plugin" not in following and following[0] not in _READ_NO_STUDY:
        following = [*following, *(word for module in modules for word in ("--plugin", module))]
    return f"Next: vsajax {shlex.join(following)}"


def fresh(path: Path) -> Path:
    """Return a path where nothing lies yet: this one, or the first of `NAME-2`, `NAME-3`, …."""
    if not path.exists():
        return path
    others = (path.with_name(f"{path.stem}-{number}{path.suffix}") for number in itertools.count(2))
    return next(other for other in others if not other.exists())


def run_folder(name: str, beside: Path | None = None) -> Path:
    """Return a free run folder: beside another run, or below `runs`."""
    return fresh((Path("runs") if beside is None else beside.parent) / name)


def again(*, without: str = "", extra: Sequence[object] = ()) -> Words:
    """Return the words of the command that runs now, one left out and some added."""
    given: Sequence[str] = click.get_current_context().find_root().obj or ()
    return [*(word for word in given if word != without), *map(str, extra)]


Following = Words | Callable[[], Words]


def start(kind: str = "serial", stem: str = "study") -> Words:
    """Return how to write an example of a kind."""
    return words("init", kind, fresh(Path(f"{stem}.toml")))


def deploy(config: Path, settings: Sequence[str] = ()) -> Words:
    """Return how to export a configuration as C, checked by a compiler where there is one."""
    return words("export", config, "--to", "c99", "-o", fresh(Path("deploy")), "--check", settings=settings)
