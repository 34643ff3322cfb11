"""The clock of a log: time stamps in seconds, what is odd about them, and signals brought to other stamps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Literal

import numpy as np

from tuning.files.errors import input_error
from tuning.logs.columns import LogFile
from tuning.logs.findings import Fault
from tuning.logs.signal_map import PER_SECOND, Clock
from tuning.logs.streams import column_in

FEWEST_SAMPLES = 3
GAP = 5.0
"""In median time steps; longer steps are gaps."""
_SLOWEST_PLAUSIBLE_STEP = 1.0
"""In seconds; a joint sampled more slowly is more likely a wrong clock unit."""
_MOST_SAMPLES = 20_000_000
_SET = 3590.0
"""In seconds; a clock that jumps by as much, and by ten times what the rest of the log lasts, was set."""
_TIMES_THE_REST = 10.0
_MANY = 0.1
"""Share of the samples that have the stamp of the one before, from which stamps have lost their digits."""
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


def resolve_clock(stream: LogFile, clock: Clock, blame: str, notes: list[str]) -> Clock:
    """Return the clock with the unit and the zero that the type of its column gives, where it gives them.

    Raises:
        InputError: neither the map nor the column says the unit.
    """
    column = column_in(stream, clock.column)
    if clock.nanoseconds is not None:
        return clock.model_copy(update={"unit": "ns"})
    if stream.holds_dates(column):
        if clock.unit not in (None, "ns"):
            notes.append(f"clock.unit {clock.unit!r} is not needed: {column!r} holds {stream.type_of(column)}")
        # As text there are times of day, of which midnight is no zero of interest.
        is_dated = not stream.is_duration(column) or stream.lines is not None
        return clock.model_copy(update={"unit": "ns", "start_at_zero": clock.start_at_zero or is_dated})
    if clock.unit is None:
        raise input_error(
            f"{blame}: clock.unit",
            f"is missing, and {column!r} holds plain numbers",
            f"add it; allowed are {', '.join(map(repr, PER_SECOND))}",
        )
    return clock


def read_stamps(stream: LogFile, column: str, rows: np.ndarray, nanoseconds: str | None = None) -> np.ndarray:
    """Return the stamps of a column, or of one of whole seconds and another of what is to be added in ns.

    Raises:
        InputError: cells are no stamps; names the first.
    """
    stamps = stream.numbers(column_in(stream, column), rows)
    if nanoseconds is None:
        return stamps
    return stamps.astype(np.int64) * 1_000_000_000 + stream.numbers(nanoseconds, rows).astype(np.int64)


def rows_since(stream: LogFile, clock: Clock, rows: np.ndarray, place: str, notes: list[str]) -> np.ndarray:
    """Return the rows whose stamps are not before `clock.not_before`.

    Raises:
        InputError: there are none, or it is no stamp.
    """
    if clock.not_before is None:
        return rows
    since = clock.not_before
    if isinstance(since, str):
        try:
            date = datetime.fromisoformat(since)
        except ValueError:
            raise input_error(
                f"{place}: clock.not_before", f"got {since!r}, which is no date in ISO 8601", "2024-03-01 13:10:34"
            ) from None
        seconds = (date if date.tzinfo else date.replace(tzinfo=UTC)) - datetime(1970, 1, 1, tzinfo=UTC)
        since = (seconds.days * 86400 + seconds.seconds) * 10**9 + seconds.microseconds * 1000
        if clock.unit != "ns":
            since /= 1e9 / PER_SECOND[clock.unit or "s"]
    elif clock.nanoseconds is not None:
        since = round(since * 10**9)
    stamps = read_stamps(stream, clock.column, rows, clock.nanoseconds)
    kept = rows[stamps >= since]
    if not kept.size:
        raise input_error(
            f"{place}: clock.not_before",
            f"got {clock.not_before!r}, after every sample",
            f"the stamps run to {stamps.max()}",
        )
    notes.append(f"{rows.size - kept.size} samples before {clock.not_before} left out (clock.not_before)")
    return kept


def read_clock(
    log: LogFile,
    clock: Clock,
    stamps: np.ndarray,
    rows: np.ndarray,
    *,
    column: str | None = None,
    start: Any = None,
    readings: Mapping[str, np.ndarray] | None = None,
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Return the time [s] of the samples that are kept, which these are, and notes.

    Args:
        log: where the stamps are from.
        clock: how to read them.
        stamps: as the file has them.
        rows: their rows in the file.
        column: their name, by default the clock's.
        start: the stamp at zero, by default the first.
        readings: what was recorded at the stamps, by signal.

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
            log.path,
            f"{kept.size} samples are left; at least {FEWEST_SAMPLES} are needed",
            _why_equal(column, clock, stamps, readings) if clock.drop_duplicates else "record for longer",
        )
    if clock.nominal_step is not None:
        return _count(log, clock, stamps, rows, column)
    time = clock.to_seconds(stamps[kept], start)
    if (backward := np.flatnonzero(np.diff(time) <= 0.0)).size:
        before, after = (int(kept[backward[0] + i]) for i in (0, 1))
        if time[backward[0]] == time[backward[0] + 1]:
            fix = _why_equal(column, clock, stamps, readings)
        else:
            fix = (
                "sort the file, select one run of it, cut it where its clock was set back, "
                "or check clock.column and clock.unit in the signal map"
            )
        raise input_error(
            f"{log.path}: {log.place(int(rows[after]))}",
            f"time must strictly increase, but {column!r} goes from {stamps[before]} "
            f"({log.place(int(rows[before]))}) to {stamps[after]} "
            f"(at {backward.size} of {time.size} samples)",
            fix,
        )
    if clock.start_at_zero and start is None and stamps[0] != 0:
        notes.append(f"time starts at zero where {column!r} is {_shown(log, column, clock, stamps[0])}")
    return time, kept, notes


def _count(
    log: LogFile, clock: Clock, stamps: np.ndarray, rows: np.ndarray, column: str
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Return the time of samples that are a known step apart, whatever their stamps say."""
    step = clock.nominal_step or 0.0
    if (backward := np.flatnonzero(np.diff(stamps) < 0)).size:
        row = log.place(int(rows[backward[0] + 1]))
        raise input_error(
            f"{log.path}: {row}", f"{column!r} runs back there", "select one run of the file, or cut it there"
        )
    time = step * np.arange(stamps.size)
    span = float(stamps[-1] - stamps[0]) / PER_SECOND[clock.unit or "s"]
    said = f"samples are counted, {1e3 * step:.4g} ms apart (clock.nominal_step): none may be lost"
    return time, np.arange(stamps.size), [f"{said}; {time[-1]:.4g} s in all, {span:.4g} s by the stamps"]


def _why_equal(column: str, clock: Clock, stamps: np.ndarray, readings: Mapping[str, np.ndarray] | None) -> str:
    """Return the way out where samples share a stamp."""
    if np.all(stamps == stamps[0]):
        other = (
            f"{column.removesuffix('header.stamp')}received"
            if column.endswith("header.stamp")
            else "another column"
        )
        never = f"{column!r} is {stamps[0]} in every sample: its clock never ran; set clock.column to {other}"
        # As a float of 32 bits has it, or six digits.
        lost = ", or its stamps have lost their digits: then clock.nominal_step replaces them"
        return never + (lost if stamps[0] else "")
    first = int(np.argmax(stamps != stamps[0]))
    if first > 1 and _was_set(float(stamps[first] - stamps[0]), stamps[first:], clock):
        return (
            f"the clock stood at {stamps[0]} for {first} samples, until it was set: take the part after that, "
            f"clock.not_before = {stamps[first]} in the signal map"
        )
    equal = np.diff(stamps) == 0
    differing = [np.diff(values)[equal] != 0 for values in (readings or {}).values() if values.size == stamps.size]
    if np.mean(equal) >= _MANY and differing and np.mean(np.any(differing, axis=0)) > 0.5:
        steps = np.diff(stamps)[~equal]
        return (
            f"the stamps have lost their digits: they step by {float(np.median(steps)):.6g} while the readings go "
            "on. Write them with more, or, if the sample time is known and no sample was lost, set "
            "clock.nominal_step in the signal map to it, in seconds"
        )
    return "set clock.drop_duplicates = true in the signal map, or check clock.column and clock.unit"


def _was_set(jump: float, rest: np.ndarray, clock: Clock) -> bool:
    scale = PER_SECOND[clock.unit or "s"]
    return jump > scale * _SET and jump > _TIMES_THE_REST * abs(float(rest[-1] - rest[0]))


def find_jumps(log: LogFile, clock: Clock, stamps: np.ndarray, rows: np.ndarray, time: np.ndarray) -> list[Fault]:
    """Return the fault of a clock that was set while it was recorded.

    Args:
        log: where the stamps are from.
        clock: how to read them.
        stamps: as the file has them, strictly increasing.
        rows: their rows in the file.
        time: the same [s].
    """
    steps = np.diff(time)
    # Where every step is long, it is the unit that is wrong.
    large = np.flatnonzero(steps > _SET) if np.median(steps) <= _SLOWEST_PLAUSIBLE_STEP else np.arange(0)
    lasting = float(steps.sum() - steps[large].sum())
    large = large[steps[large] > _TIMES_THE_REST * lasting]
    if not large.size:
        return []
    last = int(large[-1])
    before, after = stamps[last], stamps[last + 1]
    since = _shown(log, clock.column, clock, after)
    said = (
        f"jumps by {_duration(float(steps[last]))}, from {_shown(log, clock.column, clock, before)} "
        f"({log.place(int(rows[last]))}) to {since} ({log.place(int(rows[last + 1]))}), "
        f"in a log of {lasting:.4g} s"
    )
    is_text = log.holds_dates(column_in(log, clock.column)) or clock.nanoseconds is not None
    value = f'"{_date(after)}"' if is_text else f"{after}"
    fix = f"Was it set there, or are these two recordings? Take the part after it: clock.not_before = {value}"
    return [Fault("clock set", "time", said, fix)]


def find_lost_digits(clock: Clock, stamps: np.ndarray, readings: Mapping[str, np.ndarray]) -> list[Fault]:
    """Return the fault of stamps so coarse that dropping those that agree threw most of the log away."""
    equal = np.diff(stamps) == 0
    if not clock.drop_duplicates or np.mean(equal) < 0.5:
        return []
    why = _why_equal(clock.column, clock, stamps, readings)
    if not why.startswith("the stamps"):
        return []
    dropped = f"{np.count_nonzero(equal)} of {stamps.size}"
    said = f"has the stamp of the sample before in {dropped} samples, which are dropped"
    return [Fault("coarse clock", "time", said, why[0].upper() + why[1:])]


def _duration(seconds: float) -> str:
    for unit, length in (("years", 365.25 * 86400.0), ("days", 86400.0), ("h", 3600.0)):
        if seconds >= length:
            return f"{seconds / length:.4g} {unit}"
    return f"{seconds:.4g} s"


def _date(nanoseconds: Any) -> str:
    # A data frame's stamps have nanoseconds, Python's dates have not.
    return str(np.datetime64(int(nanoseconds), "ns")).replace("T", " ")


def _shown(log: LogFile, column: str, clock: Clock, stamp: Any) -> str:
    """Return a stamp as its file shows it."""
    name = column_in(log, column)
    if log.holds_dates(name):
        return f"{stamp / 1e9:.9g} s" if log.is_duration(name) else _date(stamp)
    return f"{stamp} {clock.unit}"


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
