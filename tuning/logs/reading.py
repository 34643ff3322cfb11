"""Recordings of a compliant joint, simulated or real, brought to canonical columns in SI units."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pyarrow as pa

from tuning.files.errors import InputError, Mistake, input_error, printable
from tuning.files.whole import write_table
from tuning.logs.clock import (
    FEWEST_SAMPLES,
    ClockReport,
    at_times,
    find_jumps,
    find_lost_digits,
    is_same,
    on_regular_clock,
    read_clock,
    read_stamps,
    resolve_clock,
    rows_since,
)
from tuning.logs.columns import LogFile, read_plain_file
from tuning.logs.faults import find_units, find_wraps, resolution
from tuning.logs.findings import Fault, Samples, is_sound
from tuning.logs.positions import find_gear, find_rigid
from tuning.logs.samples import find_held, find_spikes
from tuning.logs.signal_map import (
    KINDS,
    Angle,
    Clock,
    Kind,
    SignalMap,
    Torque,
    canonical_map,
    name_need,
    position_of,
    read_signal_map,
    signals_of,
    unmet_needs,
)
from tuning.logs.streams import Log, column_in, open_log
from tuning.logs.units import unit_named

__all__ = ["RecordingTable", "read_recording", "read_series", "write_table"]

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
        signal_map: how the file was read.
        clock: how regularly it was sampled, before any resampling.
        faults: what is wrong with it.
        resolutions: the steps in which quantised signals move, in SI, by canonical name.
    """

    columns: dict[str, np.ndarray]
    kind: Kind
    source: str
    notes: tuple[str, ...]
    signal_map: SignalMap
    clock: ClockReport
    faults: tuple[Fault, ...] = ()
    resolutions: Mapping[str, float] = field(default_factory=dict)


def read_recording(
    path: Path,
    map_path: Path | None = None,
    *,
    kind: str | None = None,
    select: Mapping[str, str | float] | None = None,
) -> RecordingTable:
    """Return the recording in a log of any format that `tuning.logs.formats` reads.

    Args:
        path: the file, or the folder of a bag.
        map_path: a signal map (`tuning.logs.signal_map`); without one the columns must be canonical.
        kind: of the joint, where no map says it; else it is inferred from the columns.
        select: keep only the rows whose column equals the value; overrides the map's, key by key.

    Raises:
        InputError: the file or the map cannot be used; carries every mistake found.
    """
    if kind is not None and kind not in KINDS:
        raise input_error("kind", f"got {kind!r}; allowed are {', '.join(KINDS)}")
    signal_map = None if map_path is None else read_signal_map(map_path)
    log = open_log(path) if signal_map is None else open_log(path, signal_map.join, signal_map.file)
    notes = log.notes
    if signal_map is None:
        signal_map = _map_canonical(log, cast("Kind | None", kind), notes)
    elif kind not in (None, signal_map.kind):
        notes.append(f"kind {signal_map.kind!r} of the signal map holds, not {kind!r}")
    blame = str(path if map_path is None else map_path)

    wanted = {**signal_map.select, **(select or {})}
    _require_columns(log, signal_map, wanted, blame)
    main = log.main(signal_map.clock.column, (s.column for s in signal_map.signals.given().values()))
    clock = resolve_clock(main, signal_map.clock, blame, notes if map_path else [])
    signal_map = signal_map.model_copy(update={"clock": clock})
    rows = _usable_rows(log, main, signal_map, wanted, blame, notes)
    rows = rows_since(main, clock, rows, blame, notes)
    notes += _unlike_units(log, signal_map)
    raw, foreign = _read_numbers(log, main, signal_map, rows, wanted, blame, notes)
    readings = {name: values for name, values in raw.items() if name != "time"}
    time, kept, said = read_clock(main, clock, raw["time"], rows, readings=readings)
    notes += said
    report = ClockReport.of(time)
    faults = find_jumps(main, clock, raw["time"][kept], rows[kept], time)
    notes += [] if faults else report.notes(clock)
    faults += find_lost_digits(clock, raw["time"], readings)
    own = {name: values[kept] for name, values in readings.items()}
    samples = {name: Samples(name, values, time, rows[kept], main) for name, values in own.items()}
    start = raw["time"][kept[0]]
    for name, one in foreign.items():
        stamps = clock.to_seconds(one.stamps, start)
        samples[name] = Samples(name, one.values, stamps, one.rows, one.stream)
    for name, signal in signal_map.signals.given().items():
        one = samples[name]
        spikes = find_spikes(one, signal)
        faults += spikes or find_wraps(name, signal, one.values, one.log, one.rows)
    columns = _convert(own, signal_map, blame, notes)
    if foreign:
        time, columns = _join(time, columns, foreign, signal_map, blame, notes, start=start)
    readings = own | {name: signal.values for name, signal in foreign.items()}
    faults += find_units(signal_map, samples, columns)
    columns = _drive(time, columns, signal_map)
    faults = _judge_signals(time, columns, samples, signal_map, faults)
    if map_path is None:
        way = f"; there is no map yet: vsajax init map {path}"
        faults = [replace(one, fix=one.fix + way) if "signals." in one.fix else one for one in faults]
    if signal_map.clock.sample_time is not None:
        time, columns, said = on_regular_clock(time, columns, signal_map.clock, blame)
        notes += said
    in_order = {name: columns[name] for name in signal_map.signals.given()}
    return RecordingTable(
        {"time": time, **in_order},
        signal_map.kind,
        str(path),
        tuple(notes),
        signal_map,
        report,
        tuple(faults),
        _resolutions(signal_map, readings),
    )


def _judge_signals(
    time: np.ndarray,
    columns: Mapping[str, np.ndarray],
    samples: Mapping[str, Samples],
    signal_map: SignalMap,
    faults: Sequence[Fault],
) -> list[Fault]:
    """Return the faults with what signals say of each other, where no other fault would speak for them."""
    sound = is_sound(time, faults)
    if any(fault.name == "out of range" for fault in faults) or np.count_nonzero(sound) < FEWEST_SAMPLES:
        return list(faults)
    found = find_held(time, columns, samples)
    held = {fault.signal for fault in found}
    # Who was held jumps when it is let go.
    faults = [fault for fault in faults if not (fault.name == "wrapped encoder" and fault.signal in held)]
    sound &= is_sound(time, found)
    known = {fault.name for fault in (*faults, *found)}
    trusted = {name: values[sound] for name, values in columns.items()}
    if np.count_nonzero(sound) >= FEWEST_SAMPLES and not known & {"wrapped encoder", "frozen signal"}:
        found += find_rigid(signal_map, trusted)
        if not known & {"degrees for radians", "wrong unit", "swapped sign"}:
            found += find_gear(signal_map, trusted)
    return [*faults, *found]


def read_series(path: Path, column: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the `time` column [s] of a CSV or Parquet file, from zero, and another of its columns.

    Raises:
        InputError: the file cannot be used, lacks a column, or time does not strictly increase.
    """
    log = read_plain_file(path)
    absent = [(str(path), f"no column {name}", name) for name in ("time", column) if name not in log.names]
    if absent:
        way_out = 'call the clock "time", and name the torque: column = "…" beside path'
        raise InputError(*_missing_columns(Log(path, (log,)), absent, way_out))
    rows = np.arange(log.table.num_rows)
    clock = resolve_clock(log, Clock(column="time", unit="s"), str(path), [])
    time, *_ = read_clock(log, clock, log.numbers("time", rows), rows)
    return time, log.numbers(column, rows).astype(np.float64)


def _map_canonical(log: Log, kind: Kind | None, notes: list[str]) -> SignalMap:
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
        way_out = "rename them, or say which is which in a signal map (an example: vsajax init logs/hebi map.toml)"
        raise InputError(*_missing_columns(log, absent, way_out))
    _require_si(log, known)
    ignored = [n for n in log.names if n and n != "time" and n not in signals_of(known)]
    if ignored:
        shown = ", ".join(map(printable, ignored))
        notes.append(f"columns ignored, being no signals of kind {known!r}: {shown}")
    return canonical_map(known, present)


def _require_si(log: Log, kind: Kind) -> None:
    """Refuse canonical columns that a line of units says are not in SI."""
    si = {"time": "s"} | {n: s.unit for n, s in canonical_map(kind, set(signals_of(kind))).signals.given().items()}
    way_out = "say so in a signal map: vsajax init map LOG proposes one"
    mistakes = [
        Mistake(f"{log.path}: {name}", f"is in {said!r} by the line of units, but is read in {si[name]}", way_out)
        for stream in log.streams
        for name, said in stream.units.items()
        if name in si and unit_named(said) != si[name]
    ]
    if mistakes:
        raise InputError(*mistakes)


def _unlike_units(log: Log, signal_map: SignalMap) -> list[str]:
    """Return where a line of units in the file and the map differ."""
    found = []
    for name, signal in {"clock": signal_map.clock, **signal_map.signals.given()}.items():
        stream = log.of(signal.column)
        said = stream.units.get(column_in(stream, signal.column), "")
        unit = "ns" if name == "clock" and signal_map.clock.unit is None else signal.unit
        if said and unit_named(said) not in (None, unit):
            found.append(f"{name} is read in {unit}, as the map says; the file's line of units says {said!r}")
    return found


def _infer_kind(present: set[str]) -> Kind:
    if "motor1_position" in present:
        return "antagonistic"
    return "serial" if "setpoint_position" in present else "sea"


def _missing_columns(log: Log, absent: list[tuple[str, str, str]], way_out: str = "") -> list[Mistake]:
    """Return the mistakes for `absent` (place, problem, name sought); the last lists what there is."""
    hints = [f"did you mean {near!r}?" if (near := log.nearest(name)) else "" for *_, name in absent]
    present = f"columns present: {', '.join(printable(name) or '(unnamed)' for name in log.names)}"
    hints[-1] = "; ".join(filter(None, (hints[-1], present, way_out)))
    return [Mistake(place, problem, hint) for (place, problem, _), hint in zip(absent, hints, strict=True)]


def _absence(log: Log, column: str) -> str:
    """Return why a column is not there."""
    for topic, kind in log.unread.items():
        if column.startswith(f"{topic}/"):
            return f"topic {topic} is there, but neither {log.path} nor this program has the definition of {kind}"
    return f"no column {column!r} in {log.path}"


def _require_columns(log: Log, signal_map: SignalMap, select: Mapping[str, object], blame: str) -> None:
    sought = {"clock.column": signal_map.clock.column}
    sought |= {"clock.nanoseconds": ns} if (ns := signal_map.clock.nanoseconds) else {}
    sought |= {f"select.{column}": column for column in select}
    sought |= {f"signals.{name}.column": s.column for name, s in signal_map.signals.given().items()}
    sought |= {f"signals.{name}.clock": s.clock for name, s in signal_map.signals.given().items() if s.clock}
    absent = [
        (f"{blame}: {key}", _absence(log, column), column)
        for key, column in sought.items()
        if not log.count(column)
    ]
    mistakes = _missing_columns(log, absent) if absent else []
    mistakes += [
        Mistake(
            f"{blame}: {key}",
            f"{count} columns of {log.path} are named {column!r}",
            "rename all but one" if len(log.streams) == 1 else f"say of which file: '{log.path.name}:{column}'",
        )
        for key, column in sought.items()
        if (count := log.count(column)) > 1
    ]
    if not mistakes:
        signals = signal_map.signals.given().values()
        main = log.main(signal_map.clock.column, (signal.column for signal in signals))
        held = [id(main), *(id(log.of(signal.column)) for signal in signals)]
        mistakes += [
            Mistake(
                f"{blame}: select.{column}",
                f"is recorded neither with the clock {signal_map.clock.column!r} nor with a mapped signal",
                "select by a column of one of their tables",
            )
            for column in select
            if id(log.of(column)) not in held
        ]
        ns = signal_map.clock.nanoseconds
        if ns is not None and ns not in main.names:
            mistakes.append(Mistake(f"{blame}: clock.nanoseconds", "is not of the clock's own table", "mend it"))
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


def _usable_rows(
    log: Log,
    stream: LogFile,
    signal_map: SignalMap,
    select: Mapping[str, str | float],
    blame: str,
    notes: list[str],
) -> np.ndarray:
    """Return the selected rows of a stream that hold all of its mapped signals.

    Raises:
        InputError: none is left, or several publishers wrote them.
    """
    own = {n: value for n, value in select.items() if log.of(n) is stream or n in stream.shared}
    selected = _select_rows(stream, own, notes)
    columns = [s.column for s in signal_map.signals.given().values() if log.of(s.column) is stream]
    rows = stream.filled([column_in(stream, column) for column in columns], selected)
    if not rows.size:
        shown = " and ".join(map(repr, columns))
        raise input_error(stream.path, f"no message has {shown} together", "map other columns, or select others")
    if rows.size < selected.size:
        topic = columns[0].rpartition("/")[0]
        left = f"{selected.size - rows.size} of {selected.size} messages of {topic} left out"
        notes.append(f"{left}: they are without {' or '.join(map(repr, columns))}")
    if stream.publisher is not None and stream.publisher not in own:
        writers = list(dict.fromkeys(stream.column(stream.publisher).take(pa.array(rows)).to_pylist()))
        if len(writers) > 1:
            ways = " or ".join(
                f'"{stream.publisher}" = {json.dumps(writer, ensure_ascii=False)}'
                for writer in writers[:_VALUES_SHOWN]
            )
            raise input_error(
                f"{blame}: {stream.publisher.rpartition('/')[0]}",
                f"has messages of {len(writers)} publishers with {' and '.join(map(repr, columns))}",
                f"say whose are meant, in [select]: {ways}",
            )
    return rows


def _is_same(cell: object, wanted: str | float) -> bool:
    # A shell gives text where the file may hold numbers: the file's type decides.
    if isinstance(cell, int | float) and not isinstance(cell, bool):
        try:
            return cell == float(wanted)
        except ValueError:
            return False
    return str(cell).lower() == str(wanted).lower() if isinstance(cell, bool) else str(cell) == str(wanted)


@dataclass(frozen=True)
class _Foreign:
    """A signal with stamps of its own, as the file has both."""

    stream: LogFile
    rows: np.ndarray
    column: str
    stamps: np.ndarray
    values: np.ndarray


def _read_numbers(
    log: Log,
    main: LogFile,
    signal_map: SignalMap,
    rows: np.ndarray,
    select: Mapping[str, str | float],
    blame: str,
    notes: list[str],
) -> tuple[dict[str, np.ndarray], dict[str, _Foreign]]:
    """Return the clock, under `time`, with the signals that share its rows, and the signals that do not."""
    raw: dict[str, np.ndarray] = {}
    foreign: dict[str, _Foreign] = {}
    mistakes: list[Mistake] = []
    usable: dict[int, np.ndarray] = {}

    def read(stream: LogFile, column: str, at: np.ndarray) -> np.ndarray:
        try:
            return stream.numbers(column_in(stream, column), at)
        except InputError as error:
            mistakes.extend(error.mistakes)
            return np.zeros(len(at))

    clock = signal_map.clock
    try:
        raw["time"] = read_stamps(main, clock.column, rows, clock.nanoseconds)
    except InputError as error:
        mistakes.extend(error.mistakes)
    for name, signal in signal_map.signals.given().items():
        stream = log.of(signal.column)
        if stream is main and signal.clock in (None, signal_map.clock.column):
            raw[name] = read(main, signal.column, rows)
            continue
        shared = clock.column if clock.column in stream.shared else None
        column = signal.clock or stream.clock or shared
        if column is None or column_in(stream, column) not in stream.names:
            mistakes.append(
                Mistake(
                    f"signals.{name}.clock",
                    "is missing: the signal does not share its rows with the clock "
                    f"{signal_map.clock.column!r} ({stream.table.num_rows} and {main.table.num_rows} rows)"
                    if column is None
                    else f"{column!r} does not share its rows with {signal.column!r}",
                    "name the column of the signal's own time stamps",
                )
            )
            continue
        if stream.holds_dates(column_in(stream, column)) != main.holds_dates(column_in(main, clock.column)):
            problem = f"{column!r} and {clock.column!r} count time in different ways: only one of them holds dates"
            mistakes.append(Mistake(f"signals.{name}.clock", problem, "name two columns of one kind"))
            continue
        if id(stream) not in usable:
            usable[id(stream)] = _usable_rows(log, stream, signal_map, select, blame, notes)
        its = usable[id(stream)]
        foreign[name] = _Foreign(stream, its, column, read(stream, column, its), read(stream, signal.column, its))
    if mistakes:
        raise InputError(*dict.fromkeys(mistakes))
    return raw, foreign


def _join(
    time: np.ndarray,
    columns: dict[str, np.ndarray],
    foreign: Mapping[str, _Foreign],
    signal_map: SignalMap,
    blame: str,
    notes: list[str],
    *,
    start: Any,
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Bring signals with stamps of their own to the clock, where that was asked for or changes nothing."""
    method = signal_map.clock.resample
    found: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    mistakes: list[Mistake] = []
    for name, one in foreign.items():
        clock = signal_map.clock.model_copy(update={"nominal_step": None})
        own, kept, _ = read_clock(one.stream, clock, one.stamps, one.rows, column=one.column, start=start)
        values = _convert({name: one.values[kept]}, signal_map, blame, notes)[name]
        found[name] = own, values
        if method is None and not is_same(time, own):
            mistakes.append(
                Mistake(
                    f"{blame}: signals.{name}",
                    f"is sampled at other instants ({one.column!r}) than the clock {signal_map.clock.column!r}",
                    'set clock.resample = "linear", or "previous" for a signal that holds its value',
                )
            )
    if mistakes:
        raise InputError(*mistakes)
    first = max(time[0], *(own[0] for own, _ in found.values()))
    last = min(time[-1], *(own[-1] for own, _ in found.values()))
    tolerance = 1e-3 * float(np.median(np.diff(time)))
    inside = (time >= first - tolerance) & (time <= last + tolerance)
    if np.count_nonzero(inside) < FEWEST_SAMPLES:
        raise input_error(
            blame, "the signals were hardly recorded at the same time", "check clock.unit and the signals' clocks"
        )
    if not inside.all():
        notes.append(f"{np.count_nonzero(~inside)} samples cut off, at which not every signal was recorded")
    time, columns = time[inside], {name: values[inside] for name, values in columns.items()}
    for name, (own, values) in found.items():
        if is_same(time, own):
            columns[name] = values
        else:
            columns[name] = at_times(np.clip(time, own[0], own[-1]), own, values, method or "linear")
            notes.append(f"{name} brought from {own.size} stamps of its own to the clock's ({method})")
    return time, columns


def _drive(time: np.ndarray, columns: dict[str, np.ndarray], signal_map: SignalMap) -> dict[str, np.ndarray]:
    """Make torques of motor voltages."""
    driven = {}
    for name, signal in signal_map.signals.given().items():
        if isinstance(signal, Torque) and signal.drive is not None:
            position = columns.get(position_of(name), np.zeros_like(time))
            driven[name] = signal.drive.torque(columns[name], time, position)
    return columns | driven


def _resolutions(signal_map: SignalMap, raw: Mapping[str, np.ndarray]) -> dict[str, float]:
    found = {}
    for name, signal in signal_map.signals.given().items():
        step = resolution(raw[name])
        if step is not None:
            zero, one = signal.to_si(np.array([0.0, step]))
            found[name] = abs(float(one - zero))
    return found


def _convert(
    raw: Mapping[str, np.ndarray], signal_map: SignalMap, blame: str, notes: list[str]
) -> dict[str, np.ndarray]:
    columns, mistakes = {}, []
    for name, signal in signal_map.signals.given().items():
        if name not in raw:
            continue
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
