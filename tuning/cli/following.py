"""What to type after a study was read: what makes most of it. Nothing here imports jax."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tuning.study.base import Study
from tuning.terminal.following import Words, deploy, fresh, run_folder, start, words


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


def use(study: Study, best: Path) -> Words:
    """Return how to use the best that a search has found: on the log that it was tuned on, or exported."""
    from tuning.kinds.log.study import LogStudy

    if not isinstance(study, LogStudy):
        return deploy(best)
    log = study.recording
    chosen = [word for column, value in log.select.items() for word in ("--select", f"{column}={value}")]
    mapped = [] if log.map is None else ["--map", log.map]
    return words("estimate", log.file, "-c", best, *mapped, *chosen)


def after_check(label: str, kind: str, path: Path, settings: Sequence[str]) -> Words:
    """Return what a file that was found valid is good for.

    Args:
        label: the name of its `FileKind`.
        kind: of a study or configuration; of what is neither, the kind of the example that it belongs to.
        path: the file.
        settings: with which it was read.
    """
    from tuning.files import kinds
    from tuning.study.kinds import kind_named

    match label:
        case kinds.STUDY.name if kind_named(kind).picture is None:
            # Its scenarios have no signals.
            return words("montecarlo", path, "-o", run_folder("montecarlo"), settings=settings)
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
