"""The files that a study names: what is in them determines results as much as the study does.

They are no part of the study's hash, which is that of its text; a run keeps their hashes beside it.
"""

from __future__ import annotations

import stat
from collections.abc import Mapping
from pathlib import Path

from tuning.files.errors import InputError, Mistake, input_error
from tuning.files.seal import hash_bytes
from tuning.study.base import Study
from tuning.study.parts.base import parts_in
from tuning.study.structures import structures

_READ = 1 << 20


def hash_inputs(study: Study) -> dict[str, str]:
    """Return the SHA-256 of every file that a study names, in any of its structures, by its path as it is named.

    Raises:
        InputError: a file is missing or cannot be read.
    """
    found = [each for _, each in structures(study, "study")] if study.tune.choices else [study]
    parts = [part for each in found for part in parts_in(each)]
    paths = dict.fromkeys(
        path for part in parts for name in part.files if (path := getattr(part, name)) is not None
    )
    return {path: _hash_file(Path(path)) for path in sorted(paths)}


def check_inputs(held: Mapping[str, str], folder: object) -> None:
    """Check that files still hold what they held when a run was begun.

    Raises:
        InputError: names every file that has changed or cannot be read.
    """
    mistakes: list[Mistake] = []
    for path, digest in held.items():
        try:
            if _hash_file(Path(path)) != digest:
                problem = f"has changed since the run in {folder} was begun"
                mistakes.append(Mistake(path, problem, "put the old file back, or name a new folder with -o"))
        except InputError as error:
            mistakes += error.mistakes
    if mistakes:
        raise InputError(*mistakes)


def _hash_file(path: Path) -> str:
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise input_error(path, "is no regular file", "name a file of samples in the study")
        with path.open("rb") as file:
            return hash_bytes(iter(lambda: file.read(_READ), b""))
    except OSError as error:
        problem = f"cannot be read ({error.strerror})"
        raise input_error(path, problem, "put the file that the study names there") from None
