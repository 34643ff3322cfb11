"""The log that a study names, read once, with what the study needs of it."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np

from tuning.files.errors import InputError, Mistake, input_error
from tuning.files.shipped import located
from tuning.kinds.log.study import LoggedRecording, LogStudy
from tuning.logs.reading import RecordingTable, read_recording
from tuning.scoring.needs import of_log
from tuning.study.limits import require

_FEWEST = 20


def read_log(study: LogStudy) -> RecordingTable:
    """Return the log of a study.

    Raises:
        InputError: it cannot be read, lacks a signal, leaves too few samples to tune on or to judge by, or
            does not fit this machine.
    """
    recording = study.recording
    table = _read(recording.model_dump_json(), study.kind, tuple(map(_state_of, study.inputs())))
    lacking = sorted(study.estimator.needs - table.columns.keys())
    if lacking:
        problem = "is missing, but the estimator needs this signal"
        raise InputError(*(Mistake(f"{table.source}: {name}", problem, "record or map it") for name in lacking))
    time = table.columns["time"]
    before = int(np.count_nonzero(time <= recording.train_until))
    if min(before, len(time) - before) < _FEWEST:
        raise input_error(
            "recording.train_until",
            f"got {recording.train_until} s, which leaves {before} samples to tune on and {len(time) - before} to "
            f"judge by; at least {_FEWEST} each are needed",
            f"choose a time within the log's {time[-1]:.4g} s",
        )
    require(of_log(study.estimator, len(time), table.source))
    return table


@functools.lru_cache(maxsize=2)
def _read(recording: str, kind: str, states: tuple[tuple[int, int], ...]) -> RecordingTable:
    """Return a log; `states` are those of its files, so that one that has changed is read again."""
    del states
    wanted = LoggedRecording.model_validate_json(recording)
    return read_recording(
        Path(wanted.file),
        None if wanted.map is None else Path(wanted.map),
        kind=kind,
        select=wanted.select or None,
    )


def _state_of(path: str) -> tuple[int, int]:
    """Return when a file was changed last, and its size; zeros where there is none, which reading it will tell."""
    try:
        found = located(Path(path)).stat()
    except OSError:
        return 0, 0
    return found.st_mtime_ns, found.st_size
