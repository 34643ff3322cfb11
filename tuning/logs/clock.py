"""The clock of a log: time stamps in seconds, what is odd about them, and signals brought to other stamps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from tuning.errors import input_error
from tuning.logs.files import LogFile
from tuning.logs.signal_map import Clock

FEWEST_SAMPLES = 3
GAP = 5.0
"""In median time steps; longer steps are gaps."""
_SLOWEST_PLAUSIBLE_STEP = 1.0
"""In seconds; a joint sampled more slowly is more likely a wrong clock unit."""
_MOST_SAMPLES = 20_000_000
_SAME = 1e-3
"""In median time steps; stamps that differ by less are the same."""


@dataclass(frozen=True)
class Gap:
    """A pause of the clock.

    Args:
        start: time of the last sample before it [s].
        length: until the next sample [s].
    """

    start: float
    length: float


@dataclass(frozen=True)
class ClockReport:
    """How regularly a log was sampled.

    Args:
        median: time step [s].
        slow: step that 99 % of the steps do not exceed [s].
        gaps: steps longer than five medians, longest first.
        missing: time in gaps beyond a median step each [s].
    """

    median: float
    slow: float
    gaps: tuple[Gap, ...]
    missing: float

    @classmethod
    def of(cls, time: np.ndarray) -> ClockReport:
        """Return the report on strictly increasing time [s]."""
        steps = np.diff(time)
        median = float(np.median(steps))
        places = np.flatnonzero(steps > GAP * median)
        places = places[np.argsort(-steps[places], kind="stable")]
        gaps = tuple(Gap(float(time[i]), float(steps[i])) for i in places)
        missing = sum(gap.length - median for gap in gaps)
        return cls(median, float(np.quantile(steps, 0.99)), gaps, missing)

    def notes(self, clock: Clock) -> list[str]:
        """Return what is worth saying."""
        found = []
        if self.gaps:
            longest, *others = self.gaps
            more = f"; {len(self.gaps)} gaps in all, {self.missing:.3g} s without samples" if others else ""
            found.append(
                f"largest gap {1e3 * longest.length:.4g} ms at t = {longest.start:.4g} s "
                f"(median time step {1e3 * self.median:.3g} ms){more}"
            )
        if self.median > _SLOWEST_PLAUSIBLE_STEP:
            found.append(
                f"median time step {self.median:.4g} s is long for a joint: is clock.unit {clock.unit!r} right?"
            )
        return found


def read_clock(
    log: LogFile,
    clock: Clock,
    stamps: np.ndarray,
    rows: np.ndarray,
    *,
    column: str | None = None,
    start: Any = None,
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Return the time [s] of the samples that are kept, which these are, and notes.

    Args:
        log: where the stamps are from.
        clock: how to read them.
        stamps: as the file has them.
        rows: their rows in the file.
        column: their name, by default the clock's.
        start: the stamp at zero, by default the first.

    Raises:
        InputError: too few are left, or time does not strictly increase.
    """
    column = column or clock.column
    notes: list[str] = []
    kept = np.arange(stamps.size)
    if clock.drop_duplicates:
        kept = np.flatnonzero(np.concatenate([[True], np.diff(stamps) != 0]))
        if kept.size < stamps.size:
            notes.append(f"{stamps.size - kept.size} duplicate timestamps dropped (drop_duplicates = true)")
    if kept.size < FEWEST_SAMPLES:
        raise input_error(
            log.path, f"{kept.size} samples are left; at least {FEWEST_SAMPLES} are needed", "record for longer"
        )
    time = clock.to_seconds(stamps[kept], start)
    if (backward := np.flatnonzero(np.diff(time) <= 0.0)).size:
        before, after = (int(kept[backward[0] + i]) for i in (0, 1))
        if time[backward[0]] == time[backward[0] + 1]:
            fix = "set clock.drop_duplicates = true in the signal map, or check clock.column and clock.unit"
        else:
            fix = "sort the file, select one run of it, or check clock.column and clock.unit in the signal map"
        raise input_error(
            f"{log.path}: {log.place(int(rows[after]))}",
            f"time must strictly increase, but {column!r} goes from {stamps[before]} "
            f"({log.place(int(rows[before]))}) to {stamps[after]} "
            f"(at {backward.size} of {time.size} samples)",
            fix,
        )
    if clock.start_at_zero and start is None and stamps[0] != 0:
        notes.append(f"time starts at zero where {column!r} is {stamps[0]} {clock.unit}")
    return time, kept, notes


def is_same(time: np.ndarray, other: np.ndarray) -> bool:
    """Return whether two clocks have the same stamps."""
    return time.shape == other.shape and bool(np.all(np.abs(time - other) <= _SAME * np.median(np.diff(time))))


def at_times(
    wanted: np.ndarray, time: np.ndarray, values: np.ndarray, method: Literal["linear", "previous"]
) -> np.ndarray:
    """Return values at other times, all within the first and the last of their own."""
    if method == "linear":
        return np.interp(wanted, time, values)
    return values[np.searchsorted(time, wanted, side="right") - 1]


def on_regular_clock(
    time: np.ndarray, columns: Mapping[str, np.ndarray], clock: Clock, place: str
) -> tuple[np.ndarray, dict[str, np.ndarray], list[str]]:
    """Return a recording at every `clock.sample_time`, and notes.

    Raises:
        InputError: it would have too few samples, or more than fit in memory.
    """
    step, method = clock.sample_time or 0.0, clock.resample or "linear"
    count = int(np.floor((time[-1] - time[0]) / step * (1.0 + 1e-12))) + 1
    if not FEWEST_SAMPLES <= count <= _MOST_SAMPLES:
        raise input_error(
            f"{place}: clock.sample_time",
            f"got {step} s, which makes {count} samples of {time[-1] - time[0]:.4g} s; "
            f"allowed are {FEWEST_SAMPLES} to {_MOST_SAMPLES}",
            "choose about the median time step",
        )
    regular = np.minimum(time[0] + step * np.arange(count), time[-1])
    found = {name: at_times(regular, time, values, method) for name, values in columns.items()}
    notes = [f"resampled to {count} samples, one every {1e3 * step:.4g} ms ({method})"]
    steps = np.diff(time)
    inside = steps[np.clip(np.searchsorted(time, regular, side="right") - 1, 0, steps.size - 1)]
    invented = int(np.count_nonzero(inside > GAP * max(step, float(np.median(steps)))))
    if invented:
        notes.append(f"{invented} of them lie in gaps of the log: they are made up by interpolation")
    return regular, found, notes
