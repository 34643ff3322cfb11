"""The files that a study names: what is in them determines results as much as the study does.

They are no part of the study's hash, which is that of its text; a run keeps their hashes beside it.
"""

from __future__ import annotations

import stat
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tuning.files.errors import InputError, Mistake, input_error
from tuning.files.seal import hash_bytes
from tuning.files.shipped import SHIPPED, located
from tuning.study.base import Study
from tuning.study.structures import structures

_READ = 1 << 20


def hash_inputs(study: Study) -> dict[str, str]:
    """Return the SHA-256 of every file that a study names, in any of its structures, by its path as it is named.

    Raises:
        InputError: a file is missing or cannot be read.
    """
    found = [each for _, each in structures(study, "study")] if study.tune.choices else [study]
    paths = dict.fromkeys(path for each in found for path in each.inputs())
    return {path: _hash_file(study.folder / path) for path in sorted(paths)}


def absolute_inputs(tables: Any, files: Mapping[str, str], folder: Path) -> Any:
    """Return a study's tables, or the hashes of its files, for a process in another folder.

    Args:
        tables: where a text is the path of one of the files it is made absolute; those that ship stay.
        files: hashes by path as the study names it.
        folder: where relative paths start, see `Base.folder`.
    """

    def absolute(text: str) -> str:
        return str((folder / text).absolute()) if text in files and not text.startswith(SHIPPED) else text

    if isinstance(tables, Mapping):
        return {absolute(key): absolute_inputs(value, files, folder) for key, value in tables.items()}
    if isinstance(tables, list):
        return [absolute_inputs(value, files, folder) for value in tables]
    return absolute(tables) if isinstance(tables, str) else tables


def check_inputs(held: Mapping[str, str], study: Study, folder: object) -> None:
    """Check that files still hold what they held when a run was begun.

    Args:
        held: their hashes then, by their paths as the study names them.
        study: that names them.
        folder: of the run, for errors.

    Raises:
        InputError: names every file that has changed or cannot be read.
    """
    mistakes: list[Mistake] = []
    for path, digest in held.items():
        try:
            if _hash_file(study.folder / path) != digest:
                problem = f"has changed since the run in {folder} was begun"
                mistakes.append(Mistake(path, problem, "put the old file back, or name a new folder with -o"))
        except InputError as error:
            mistakes += error.mistakes
    if mistakes:
        raise InputError(*mistakes)


def _hash_file(path: Path) -> str:
    path = located(path)
    try:
        if path.is_dir():
            # The folder of a bag.
            held = sorted(inner for inner in path.iterdir() if inner.is_file())
            return hash_bytes(f"{inner.name}:{_hash_file(inner)}\n".encode() for inner in held)
        if not stat.S_ISREG(path.stat().st_mode):
            raise input_error(path, "is no regular file", "name a file of samples in the study")
        with path.open("rb") as file:
            return hash_bytes(iter(lambda: file.read(_READ), b""))
    except OSError as error:
        problem = f"cannot be read ({error.strerror})"
        raise input_error(path, problem, "put the file that the study names there") from None
