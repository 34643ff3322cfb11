"""The journal of a black-box search: Optuna's log of all trials, sealed after every whole batch.

A mark ends each batch. It says how many batches there are and what the bytes before it hash to, so that a search
goes on from the last batch that is still as it was written; what comes after it is asked for, and scored, again.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import sys
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import optuna
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend

from tuning.files.errors import InputError, input_error
from tuning.runs.folder import RunStore
from tuning.runs.sealed import is_file

_NAME = "optuna.log"
_MARK = "whole_batches"
_SET_STUDY_ATTRIBUTE = 2
"""Optuna's code of the operation that a mark is."""
_UNREADABLE = (ArithmeticError, AssertionError, AttributeError, LookupError, RuntimeError, TypeError, ValueError)
"""What Optuna raises over a journal that it cannot have written."""


@dataclass
class Journal:
    """An open journal.

    Args:
        path: its file.
        study: the Optuna study in it.
        run: what its marks are signed with.
        batches: whole batches in it.
    """

    path: Path
    study: optuna.Study
    run: str
    batches: int
    _hash: Any = field(default_factory=hashlib.sha256)
    _hashed: int = 0

    def mark(self) -> None:
        """End a batch."""
        self._catch_up()
        self.batches += 1
        value = {"batches": self.batches, "run": self.run, "sha256": self._hash.hexdigest()}
        self.study.set_user_attr(_MARK, value)

    def _catch_up(self) -> None:
        with self.path.open("rb") as file:
            file.seek(self._hashed)
            written = file.read()
        self._hash.update(written)
        self._hashed += len(written)


def open_journal(store: RunStore, objectives: int) -> Journal:
    """Return the journal of a run, cut back to its last whole batch; a new one where there is none.

    Trials that were asked for, but not all told, would otherwise stay in the samplers' history. Batches that are
    not as they were written, and those after them, are cut off too, and stderr says so.

    Raises:
        InputError: it is no file, cannot be read or written, or, in a run from before there were seals, is not one
            that Optuna can have written.
    """
    path = store.folder / _NAME
    # A killed process leaves Optuna's lock behind; the run folder's own keeps all others out.
    with contextlib.suppress(OSError):
        path.with_name(f"{path.name}.lock").unlink(missing_ok=True)
    batches = 0
    try:
        if is_file(path):
            batches, end = _whole(path, store.run, needs_seal=store.is_sealed)
            os.truncate(path, end)
        study = _load(path, objectives)
    except InputError:
        raise
    except OSError as error:
        raise input_error(path, f"cannot be read or written ({error.strerror})", "check its permissions") from None
    except _UNREADABLE as error:
        problem = f"is not a journal of this run ({type(error).__name__}: {error!s:.80})"
        raise input_error(path, problem, f"remove {path}; --resume asks for its trials again") from None
    return Journal(path, study, store.run, batches)


def _load(path: Path, objectives: int) -> optuna.Study:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        storage = JournalStorage(JournalFileBackend(str(path)))
        directions = [optuna.study.StudyDirection.MINIMIZE] * objectives
        study = optuna.create_study(storage=storage, study_name="tune", directions=directions, load_if_exists=True)
        if study.directions != directions:
            raise ValueError("it has other objectives")
        return study


def _whole(path: Path, run: str, *, needs_seal: bool) -> tuple[int, int]:
    """Return how many batches of a journal are whole and as they were written, and the bytes up to there."""
    digest = hashlib.sha256()
    batches = end = length = 0
    problem = ""
    with path.open("rb") as lines:
        for line in lines:
            if problem:
                break
            entry = _entry_of(line)
            if entry is None:
                # The last line is half a line where the process was killed while it wrote.
                problem = "holds a line that is not Optuna's" if line.endswith(b"\n") else ""
                break
            length += len(line)
            if (mark := _mark_in(entry)) is not None:
                problem = _fault(mark, batches + 1, run, digest.hexdigest(), needs_seal=needs_seal)
                if not problem:
                    batches, end = batches + 1, length
            digest.update(line)
    if problem:
        again = f"goes on from {batches} whole batches" if batches else "its trials are asked for again"
        print(f"note: {path} {problem}; {again}", file=sys.stderr)
    return batches, end


def _entry_of(line: bytes) -> dict[str, Any] | None:
    try:
        entry = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return entry if isinstance(entry, dict) and line.endswith(b"\n") else None


def _mark_in(entry: dict[str, Any]) -> Any:
    """Return what a line of the journal marks; `None` where it is no mark."""
    attributes = entry.get("user_attr")
    if entry.keys() != {"op_code", "worker_id", "study_id", "user_attr"} or not isinstance(attributes, dict):
        return None
    if (entry["op_code"], entry["study_id"]) != (_SET_STUDY_ATTRIBUTE, 0):
        return None
    return attributes[_MARK] if attributes.keys() == {_MARK} else None


def _fault(mark: Any, number: int, run: str, digest: str, *, needs_seal: bool) -> str:
    """Return what is wrong with the mark of a batch; empty where nothing is."""
    if not isinstance(mark, dict):
        is_legacy = not needs_seal and mark == number
        return "" if is_legacy else f"has no seal where batch {number} ends"
    if mark.get("run") != run:
        return "holds the trials of another run"
    is_whole = mark == {"batches": number, "run": run, "sha256": digest}
    return "" if is_whole else f"is not as it was written before batch {number} ends"
