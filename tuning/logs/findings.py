"""What is found in a log: named, with its evidence, the samples it concerns, and what to do."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tuning.logs.columns import LogFile

FaultName = Literal[
    "wrapped encoder",
    "degrees for radians",
    "wrong unit",
    "swapped sign",
    "wrong gear ratio",
    "out of range",
    "frozen signal",
    "clock set",
    "coarse clock",
    "rigid drive",
    "coarse deflection",
    "spikes",
    "zeroed signal",
    "saturated signal",
    "held signal",
    "late torque",
    "early torque",
    "negative loop",
    "lagging observer",
    "torque offset",
    "unrelated torque",
]
Severity = Literal["fault", "note"]

_SHOWN = 4
"""Stretches that are named before the rest is counted."""


@dataclass(frozen=True)
class Stretch:
    """Samples one after the other.

    Args:
        first: where a user finds the first of them, as "line 12".
        last: where the last.
        start: time of the first [s].
        end: time of the last [s].
    """

    first: str
    last: str
    start: float
    end: float

    def __str__(self) -> str:
        if self.first == self.last:
            return f"{self.first} ({self.start:.4g} s)"
        word, _, number = self.first.partition(" ")
        return f"{word}s {number} to {self.last.removeprefix(word + ' ')} ({self.start:.4g} to {self.end:.4g} s)"


@dataclass(frozen=True)
class Fault:
    """Something wrong, or odd.

    Args:
        name: what kind.
        signal: of which.
        problem: what the numbers say.
        fix: what to change.
        severity: "fault": a warning, which `--strict` makes an exit code; "note": worth knowing.
        where: the samples it concerns; empty where it concerns all.
    """

    name: FaultName
    signal: str
    problem: str
    fix: str
    severity: Severity = "fault"
    where: tuple[Stretch, ...] = ()

    def __str__(self) -> str:
        return f"{self.name}: {self.signal} {self.problem}. {self.fix}"


@dataclass(frozen=True)
class Samples:
    """A signal's readings, and where they are in its file.

    Args:
        name: of the signal.
        values: one a sample.
        time: of each [s].
        rows: of each, in the file.
        log: the file.
    """

    name: str
    values: np.ndarray
    time: np.ndarray
    rows: np.ndarray
    log: LogFile

    def stretch(self, first: int, last: int) -> Stretch:
        """Return the samples from one to another, both among them."""
        begin, end = (self.log.place(int(self.rows[at])) for at in (first, last))
        return Stretch(begin, end, float(self.time[first]), float(self.time[last]))

    def stretches(self, chosen: np.ndarray) -> tuple[Stretch, ...]:
        """Return the samples that are chosen, one stretch where they are neighbours."""
        return tuple(self.stretch(first, last) for first, last in runs_of(chosen))


def runs_of(chosen: np.ndarray) -> list[tuple[int, int]]:
    """Return the first and the last place of each run of true values."""
    starts = np.flatnonzero(np.diff(chosen.astype(int), prepend=0) == 1)
    ends = np.flatnonzero(np.diff(chosen.astype(int), append=0) == -1)
    return list(zip(starts.tolist(), ends.tolist(), strict=True))


def name_stretches(where: Sequence[Stretch]) -> str:
    """Return the first few stretches in words, the others counted."""
    more = f", and {len(where) - _SHOWN} more" if len(where) > _SHOWN else ""
    return ", ".join(map(str, where[:_SHOWN])) + more


def is_sound(time: np.ndarray, faults: Iterable[Fault]) -> np.ndarray:
    """Return which samples lie in no stretch of a fault, nor beside one, where interpolation would carry it."""
    sound = np.ones(time.size, dtype=bool)
    margin = 1.5 * float(np.median(np.diff(time)))
    for fault in faults:
        for stretch in fault.where if fault.severity == "fault" else ():
            low, high = np.searchsorted(time, [stretch.start - margin, stretch.end + margin])
            sound[low:high] = False
    return sound
