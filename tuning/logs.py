"""Recordings of a compliant joint, simulated or real, brought to canonical columns in SI units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
import pyarrow as pa

from tuning.errors import InputError, Mistake, input_error
from tuning.log_files import LogFile, read_log_file, write_table
from tuning.signal_map import (
    KINDS,
    Angle,
    Clock,
    Kind,
    SignalMap,
    canonical_map,
    name_need,
    read_signal_map,
    signals_of,
    unmet_needs,
)

__all__ = ["RecordingTable", "read_recording", "read_series", "write_table"]

_FEWEST_SAMPLES = 3
_GAP_WORTH_A_NOTE = 5.0
"""In median time steps."""
_SLOWEST_PLAUSIBLE_STEP = 1.0
"""In seconds; a joint sampled more slowly is more likely a wrong clock unit."""
_VALUES_SHOWN = 5


@dataclass(frozen=True)
class RecordingTable:
    """A recording in canonical columns.

    Args:
        columns: by canonical name, float64 and of one length, `time` [s] among them; angles in rad,
            torques in N.m, stiffnesses in N.m/rad.
        kind: of the joint.
        source: the file it came from.
        notes: sentences on what was done to the file and what was noticed in it.
    """

    columns: dict[str, np.ndarray]
    kind: Kind
    source: str
    notes: tuple[str, ...]


def read_recording(
    path: Path,
    map_path: Path | None = None,
    *,
    kind: str | None = None,
    select: Mapping[str, str | float] | None = None,
) -> RecordingTable:
    """Return the recording in a CSV or Parquet file.

    Args:
        path: the file.
        map_path: a signal map (`tuning.signal_map`); without one the columns must be canonical.
        kind: of the joint, where no map says it; else it is inferred from the columns.
        select: keep only the rows whose column equals the value; overrides the map's, key by key.

    Raises:
        InputError: the file or the map cannot be used; carries every mistake found.
    """
    if kind is not None and kind not in KINDS:
        raise input_error("kind", f"got {kind!r}; allowed are {', '.join(KINDS)}")
    signal_map = None if map_path is None else read_signal_map(map_path)
    log = read_log_file(path)
    notes: list[str] = []
    if signal_map is None:
        signal_map = _map_canonical(log, cast("Kind | None", kind), notes)
    elif kind not in (None, signal_map.kind):
        notes.append(f"kind {signal_map.kind!r} of the signal map holds, not {kind!r}")
    blame = str(path if map_path is None else map_path)

    wanted = {**signal_map.select, **(select or {})}
    _require_columns(log, signal_map, wanted, blame)
    rows = _select_rows(log, wanted, notes)
    raw = _read_numbers(log, signal_map, rows)
    time, kept = _read_clock(log, signal_map.clock, raw["time"], rows, notes)
    columns = _convert({name: values[kept] for name, values in raw.items()}, signal_map, blame, notes)
    return RecordingTable({"time": time, **columns}, signal_map.kind, str(path), tuple(notes))


def read_series(path: Path, column: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the `time` column [s] of a CSV or Parquet file, from zero, and another of its columns.

    Raises:
        InputError: the file cannot be used, lacks a column, or time does not strictly increase.
    """
    log = read_log_file(path)
    absent = [("", name, "") for name in ("time", column) if name not in log.names]
    if absent:
        raise InputError(*_missing_columns(log, absent))
    rows = np.arange(log.table.num_rows)
    time, _ = _read_clock(log, Clock(column="time", unit="s"), log.numbers("time", rows), rows, [])
    return time, log.numbers(column, rows).astype(np.float64)


def _map_canonical(log: LogFile, kind: Kind | None, notes: list[str]) -> SignalMap:
    present = set(log.names)
    known = kind or _infer_kind(present)
    if kind is None:
        notes.append(f"kind {known!r} inferred from the columns")
    lacking = [] if "time" in present else [("time", "time")]
    lacking += [(need[0][0], name_need(need)) for need in unmet_needs(known, present)]
    if lacking:
        absent = [
            (str(log.path), f"no column {words}, needed for kind {known!r}", name) for name, words in lacking
        ]
        way_out = "rename them, or say which is which in a signal map (examples: configs/logs)"
        raise InputError(*_missing_columns(log, absent, way_out))
    ignored = [n for n in log.names if n and n != "time" and n not in signals_of(known)]
    if ignored:
        notes.append(f"columns ignored, being no signals of kind {known!r}: {', '.join(ignored)}")
    return canonical_map(known, present)


def _infer_kind(present: set[str]) -> Kind:
    if "motor1_position" in present:
        return "antagonistic"
    return "serial" if "setpoint_position" in present else "sea"


def _missing_columns(log: LogFile, absent: list[tuple[str, str, str]], way_out: str = "") -> list[Mistake]:
    """Return the mistakes for `absent` (place, problem, name sought); the last lists what there is."""
    hints = [f"did you mean {near!r}?" if (near := log.nearest(name)) else "" for *_, name in absent]
    present = f"columns present: {', '.join(name or '(unnamed)' for name in log.names)}"
    hints[-1] = "; ".join(filter(None, (hints[-1], present, way_out)))
    return [Mistake(place, problem, hint) for (place, problem, _), hint in zip(absent, hints, strict=True)]


def _require_columns(log: LogFile, signal_map: SignalMap, select: Mapping[str, object], blame: str) -> None:
    sought = {"clock.column": signal_map.clock.column}
    sought |= {f"select.{column}": column for column in select}
    sought |= {f"signals.{name}.column": s.column for name, s in signal_map.signals.given().items()}
    absent = [
        (f"{blame}: {key}", f"no column {column!r} in {log.path}", column)
        for key, column in sought.items()
        if column not in log.names
    ]
    mistakes = _missing_columns(log, absent) if absent else []
    mistakes += [
        Mistake(f"{blame}: {key}", f"{count} columns of {log.path} are named {column!r}", "rename all but one")
        for key, column in sought.items()
        if (count := log.names.count(column)) > 1
    ]
    if mistakes:
        raise InputError(*mistakes)


def _select_rows(log: LogFile, select: Mapping[str, str | float], notes: list[str]) -> np.ndarray:
    rows = np.arange(log.table.num_rows)
    for name, wanted in select.items():
        cells = log.column(name).take(pa.array(rows)).to_pylist()
        existing = list(dict.fromkeys(cells))
        matching = {value for value in existing if _is_same(value, wanted)}
        if not matching:
            shown = ", ".join(repr(value) for value in existing[:_VALUES_SHOWN])
            more = f" and {len(existing) - _VALUES_SHOWN} more" if len(existing) > _VALUES_SHOWN else ""
            raise input_error(log.path, f"no row has {name} = {wanted!r}", f"values there: {shown}{more}")
        rows = rows[[cell in matching for cell in cells]]
        notes.append(f"{rows.size} of {len(cells)} rows selected by {name} = {wanted!r}")
    return rows


def _is_same(cell: object, wanted: str | float) -> bool:
    # A shell gives text where the file may hold numbers: the file's type decides.
    if isinstance(cell, int | float) and not isinstance(cell, bool):
        try:
            return cell == float(wanted)
        except ValueError:
            return False
    return str(cell).lower() == str(wanted).lower() if isinstance(cell, bool) else str(cell) == str(wanted)


def _read_numbers(log: LogFile, signal_map: SignalMap, rows: np.ndarray) -> dict[str, np.ndarray]:
    """Return the clock, under `time`, and the signals, as the file has them."""
    columns = {"time": signal_map.clock.column}
    columns |= {name: signal.column for name, signal in signal_map.signals.given().items()}
    raw, mistakes = {}, []
    for name, column in columns.items():
        try:
            raw[name] = log.numbers(column, rows)
        except InputError as error:
            mistakes += error.mistakes
    if mistakes:
        raise InputError(*dict.fromkeys(mistakes))
    return raw


def _read_clock(
    log: LogFile, clock: Clock, stamps: np.ndarray, rows: np.ndarray, notes: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the time [s] of the samples that are kept, and which these are."""
    kept = np.arange(stamps.size)
    if clock.drop_duplicates:
        kept = np.flatnonzero(np.concatenate([[True], np.diff(stamps) != 0]))
        if kept.size < stamps.size:
            notes.append(f"{stamps.size - kept.size} duplicate timestamps dropped (drop_duplicates = true)")
    if kept.size < _FEWEST_SAMPLES:
        raise input_error(
            log.path,
            f"{kept.size} samples are left; at least {_FEWEST_SAMPLES} are needed",
            "record for longer",
        )
    time = clock.to_seconds(stamps[kept])
    steps = np.diff(time)
    if (backward := np.flatnonzero(steps <= 0.0)).size:
        before, after = (int(kept[backward[0] + i]) for i in (0, 1))
        if time[backward[0]] == time[backward[0] + 1]:
            fix = "set clock.drop_duplicates = true in the signal map, or check clock.column and clock.unit"
        else:
            fix = "sort the file, select one run of it, or check clock.column and clock.unit in the signal map"
        raise input_error(
            f"{log.path}: {log.place(int(rows[after]))}",
            f"time must strictly increase, but {clock.column!r} goes from {stamps[before]} "
            f"({log.place(int(rows[before]))}) to {stamps[after]} "
            f"(at {backward.size} of {time.size} samples)",
            fix,
        )
    if clock.start_at_zero and stamps[0] != 0:
        notes.append(f"time starts at zero where {clock.column!r} is {stamps[0]} {clock.unit}")
    median, widest = float(np.median(steps)), int(np.argmax(steps))
    if steps[widest] > _GAP_WORTH_A_NOTE * median:
        notes.append(
            f"largest gap {1e3 * steps[widest]:.4g} ms at t = {time[widest]:.4g} s "
            f"(median time step {1e3 * median:.3g} ms)"
        )
    if median > _SLOWEST_PLAUSIBLE_STEP:
        notes.append(f"median time step {median:.4g} s is long for a joint: is clock.unit {clock.unit!r} right?")
    return time, kept


def _convert(
    raw: Mapping[str, np.ndarray], signal_map: SignalMap, blame: str, notes: list[str]
) -> dict[str, np.ndarray]:
    columns, mistakes = {}, []
    for name, signal in signal_map.signals.given().items():
        values = raw[name].astype(np.float64)
        if isinstance(signal, Angle) and signal.wraps_at is not None:
            if problem := signal.wrap_problem(values):
                fix = "give the counter's period in the file's unit, or drop the key if it never wraps"
                mistakes.append(Mistake(f"{blame}: signals.{name}.wraps_at", problem, fix))
            wraps = signal.count_wraps(values)
            notes.append(f"{name} unwrapped at {signal.wraps_at:g} {signal.unit}: {wraps} wraps")
        columns[name] = signal.to_si(values)
    if mistakes:
        raise InputError(*mistakes)
    return columns
