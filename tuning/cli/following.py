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
    from tuning.study.loading import Study

Words = list[str]


def words(*parts: object, settings: Sequence[str] = ()) -> Words:
    """Return a command's words, and `--set` for each of the settings that the command before it was given."""
    return [*map(str, parts), *itertools.chain.from_iterable(("--set", setting) for setting in settings)]


def sentence(following: Words) -> str:
    """Return the line that says what to type next, quoted for a shell."""
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


def start(kind: str = "serial", stem: str = "study") -> Words:
    """Return how to write an example of a kind."""
    return words("init", kind, fresh(Path(f"{stem}.toml")))


def deploy(config: Path, settings: Sequence[str] = ()) -> Words:
    """Return how to export a configuration as C, checked by a compiler where there is one."""
    return words("export", config, "--to", "c99", "-o", fresh(Path("deploy")), "--check", settings=settings)


def improve(study: Study, path: Path, settings: Sequence[str] = (), *, beside: Path | None = None) -> Words:
    """Return what makes most of a study: tune what it tunes, else its population, its grid, its export.

    Args:
        study: read from `path`.
        path: its file.
        settings: with which it was read.
        beside: a run folder next to which the next one goes; below `runs` if `None`.
    """
    from tuning.files.errors import InputError
    from tuning.study.loading import load_study

    try:
        # What was simulated may no longer fit what the study searches.
        load_study(path, settings)
    except InputError:
        return deploy(path, settings)
    if study.tune.parameters or study.tune.choices:
        folder, method = run_folder("tune", beside), _method(study)
        return words("tune", path, "-o", folder, *(["--method", method] if method else []), settings=settings)
    if study.population.paths:
        return words("montecarlo", path, "-o", run_folder("montecarlo", beside), settings=settings)
    if study.sweep.grid and beside is None:
        return words("sweep", path, "-o", run_folder("sweep"), settings=settings)
    return deploy(path, settings)


def _method(study: Study) -> str | None:
    """Return how a study can be tuned where the gradient, which is the default, cannot."""
    from tuning.files.errors import InputError
    from tuning.search.refine import plan_search

    try:
        plan_search(study, "gradient", "levenberg-marquardt", "study")
    except InputError:
        return "tpe"
    return None


def after_check(label: str, kind: str, path: Path, settings: Sequence[str]) -> Words:
    """Return what a file that was found valid is good for.

    Args:
        label: the name of its `FileKind`.
        kind: of joint, where it has one.
        path: the file.
        settings: with which it was read.
    """
    from tuning.study import kinds

    match label:
        case kinds.STUDY.name:
            return words("simulate", path, "-o", fresh(Path("recording.parquet")), settings=settings)
        case kinds.CONFIG.name:
            return deploy(path, settings)
        case kinds.LOG_STUDY.name:
            return words("tune", path, "-o", run_folder("tune"), settings=settings)
        case kinds.ARM_STUDY.name:
            return words("stiffness", path, settings=settings)
        case kinds.ARM.name:
            return start("arm", "arm")
        case _:
            return start(kind, kind)


Following = Words | Callable[[], Words]
