"""CSV and Parquet files, read so that a bad cell can be named."""

from __future__ import annotations

import difflib
import io
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet

from tuning.files.errors import InputError, Mistake, input_error
from tuning.files.whole import table_suffix
from tuning.logs.layout import AS_FOUND, FileFormat, Layout, lay_out
from tuning.logs.numerals import bad_numbers, grouping_of, to_dates, to_numbers, trimmed

TEXT_SUFFIXES = (".csv", ".tsv", ".txt", ".dat", ".asc")
READ_SUFFIXES = (*TEXT_SUFFIXES, ".parquet")
_RAGGED_LINES_SHOWN = 5


@dataclass(frozen=True)
class LogFile:
    """The columns of a file, as they are.

    Args:
        path: the file.
        names: of the columns, in order; without the blanks around them.
        table: the columns.
        clock: the column of time stamps, where the format says which that is.
        notes: sentences on what was found in the file and not told.
        keys: what was found, as keys of a map's `[file]` table.
        units: of columns, as a line of the file says them.
        lines: of the file (from 1), on which the rows begin; `None` where rows are no lines.
        decimal: mark of numbers that are text.
        row_name: what a row is.
        publisher: the column that tells apart who wrote a row, where several did.
        shared: columns that other tables of the same file have too, each with rows of its own.
        unread: topics of the file that could not be read, by name, with their types.
    """

    path: Path
    names: tuple[str, ...]
    table: pa.Table
    clock: str | None = None
    notes: tuple[str, ...] = ()
    keys: Mapping[str, Any] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    lines: np.ndarray | None = None
    decimal: str = "."
    row_name: str = "row"
    publisher: str | None = None
    shared: tuple[str, ...] = ()
    unread: Mapping[str, str] = field(default_factory=dict)

    def column(self, name: str) -> pa.ChunkedArray:
        """Return the first column of this name."""
        column = self.table.column(self.names.index(name))
        return column.cast(column.type.value_type) if pa.types.is_dictionary(column.type) else column

    def place(self, row: int) -> str:
        """Return where a user finds a row (from 0): a line of a text file, a row (from 1) of any other."""
        return f"{self.row_name} {row + 1}" if self.lines is None else f"line {self.lines[row]}"

    def filled(self, names: Iterable[str], rows: np.ndarray) -> np.ndarray:
        """Return those of the rows in which all columns have a value; all, where one without is a mistake."""
        if self.row_name == "row":
            return rows
        for name in names:
            column = self.column(name)
            if column.null_count:
                rows = rows[column.take(pa.array(rows)).is_valid().to_numpy().astype(bool)]
        return rows

    def holds_dates(self, name: str) -> bool:
        """Return whether a column holds dates, times of day or durations, which `numbers` gives in ns."""
        return pa.types.is_temporal(self.column(name).type)

    def is_duration(self, name: str) -> bool:
        """Return whether a column holds durations or times of day, whose zero is no date."""
        held = self.column(name).type
        return pa.types.is_duration(held) or pa.types.is_time(held)

    def type_of(self, name: str) -> str:
        """Return what a column holds, in words."""
        held = self.column(name).type
        if pa.types.is_timestamp(held) or pa.types.is_date(held):
            return "dates"
        if pa.types.is_temporal(held):
            return "durations" if self.lines is None else "times of day"
        return str(held)

    def nearest(self, name: str) -> str | None:
        """Return the column whose name is most like `name`, capitals apart, if any is."""
        by_lower = {known.lower(): known for known in self.names}
        near = difflib.get_close_matches(name.lower(), by_lower, 1)
        return by_lower[near[0]] if near else None

    def numeric_rows(self, name: str) -> np.ndarray:
        """Return the rows in which a column holds a finite number; none, where that is less than half of them."""
        column = self.column(name)
        if pa.types.is_string(column.type):
            cells = trimmed(column)
            good = cells.is_valid().to_numpy().astype(bool)
            good[bad_numbers(cells, self.decimal)] = False
            rows = np.flatnonzero(good)
            values = to_numbers(cells.take(pa.array(rows)), self.decimal).to_numpy()
        elif pa.types.is_floating(column.type) or pa.types.is_integer(column.type):
            rows = np.flatnonzero(column.is_valid().to_numpy().astype(bool))
            values = column.take(pa.array(rows)).to_numpy()
        else:
            return np.arange(0)
        rows = rows[np.isfinite(values)]
        return rows if 2 * rows.size > len(column) else rows[:0]

    def numbers(self, name: str, rows: np.ndarray) -> np.ndarray:
        """Return a column at `rows` as finite numbers: int64 where the file holds integers, else float64.

        Dates are int64 in ns since 1970, times of day since midnight, durations since whatever they count from.

        Raises:
            InputError: cells are not numbers, empty, NaN or infinite; names the first.
        """
        column = self.column(name).take(pa.array(rows))
        held = column.type
        if pa.types.is_temporal(held):
            return self._nanoseconds(name, column, rows)
        if pa.types.is_integer(held) and column.null_count == 0:
            return column.to_numpy().astype(np.int64)
        if pa.types.is_integer(held) or pa.types.is_floating(held) or pa.types.is_decimal(held):
            values = column.cast(pa.float64(), safe=False).to_numpy()
        elif pa.types.is_null(held):
            values = np.full(len(rows), np.nan)
        elif pa.types.is_string(held) or pa.types.is_large_string(held):
            values = self._parse(name, column, rows)
        else:
            raise input_error(
                self.path, f"column {name!r} holds {held} values, not numbers", "write it as numbers"
            )
        lost = np.flatnonzero(~np.isfinite(values))
        if lost.size:
            got = "no value or NaN" if math.isnan(values[lost[0]]) else f"{values[lost[0]]}"
            raise self._bad_cells(name, got, "a finite number", rows[lost])
        return values

    def _nanoseconds(self, name: str, column: pa.ChunkedArray, rows: np.ndarray) -> np.ndarray:
        if column.null_count:
            lost = np.flatnonzero(column.is_null().to_numpy().astype(bool))
            raise self._bad_cells(name, "no value", "a date or time", rows[lost])
        held = column.type
        try:
            if pa.types.is_duration(held):
                stamps = column.cast(pa.duration("ns")).cast(pa.int64())
            elif pa.types.is_time(held):
                stamps = column.cast(pa.time64("ns")).cast(pa.int64())
            else:
                stamps = column.cast(pa.timestamp("ns", getattr(held, "tz", None))).cast(pa.int64())
        except pa.ArrowInvalid:
            raise input_error(
                self.path, f"column {name!r} holds {held} that 64 bits of ns cannot", "are its dates right?"
            ) from None
        return stamps.to_numpy()

    def _parse(self, name: str, column: pa.ChunkedArray, rows: np.ndarray) -> np.ndarray:
        cells = trimmed(column)
        bad = bad_numbers(cells, self.decimal)
        if bad.size:
            raise self._bad_cells(name, repr(column[int(bad[0])].as_py()), "a number", rows[bad])
        return to_numbers(cells, self.decimal).cast(pa.float64()).to_numpy()

    def _bad_cells(self, name: str, got: str, wanted: str, rows: np.ndarray) -> InputError:
        more = f" ({rows.size} such rows in all)" if rows.size > 1 else ""
        ways_out = ["cut those rows out, or mend them"]
        if self.row_name != "row":
            ways_out = ["map another column, or select other messages in [select]"]
        elif got.startswith("no value") and rows.size > 0.05 * self.table.num_rows:
            ways_out.append("has each topic rows of its own? then split_rows = true in [file] of a signal map")
        if self.lines is not None and rows[0] == 0 and not got.startswith("no value"):
            line = self.lines[0]
            ways_out.append(f"in [file] of a signal map, units = true if it holds units, header = {line} if names")
        return input_error(
            f"{self.path}: {self.place(rows[0])}",
            f"column {name!r} has {got} where {wanted} is needed{more}",
            "; ".join(ways_out),
        )


def read_log_file(path: Path, told: FileFormat = AS_FOUND) -> LogFile:
    """Return the columns of a text (CSV) or Parquet file.

    Args:
        path: the file.
        told: how a text file is laid out, as far as it is known; the rest is found, and said in the notes.

    Raises:
        InputError: the file is missing, a directory, empty, unreadable, of another format, ragged, or can be read
            in two ways.
    """
    try:
        log = _read(path, told)
    except pa.ArrowException as error:
        what = "a Parquet file" if path.suffix.lower() == ".parquet" else "a table of text"
        raise input_error(path, f"cannot be read as {what}: {error}", "was it cut short or misnamed?") from None
    except UnicodeDecodeError as error:
        raise input_error(path, f"has a column whose name is not UTF-8 ({error.reason})", "rename it") from None
    except OSError as error:
        reason = error.strerror or str(error)
        raise input_error(
            path, f"cannot be read ({reason})", "check its permissions and that it is whole"
        ) from None
    if log.table.num_rows == 0:
        raise input_error(path, "has a header but no samples", "was the recording stopped before it was saved?")
    return log


def read_plain_file(path: Path) -> LogFile:
    """Return the columns of a CSV or Parquet file as `vsajax` writes them, of which nothing has to be found out.

    Raises:
        InputError: as `read_log_file`, or the file is laid out otherwise: who reads it cannot say what was found.
    """
    log = read_log_file(path)
    if log.notes:
        raise input_error(
            path,
            f"is no plain table: {log.notes[0]}",
            "save it as CSV, with one header, commas and decimal points",
        )
    return log


def _read(path: Path, told: FileFormat) -> LogFile:
    if path.is_dir():
        raise input_error(path, "is a directory", "name a file in it")
    suffix = table_suffix(path, READ_SUFFIXES)
    check_readable(path)
    if suffix in TEXT_SUFFIXES:
        layout = lay_out(path, told)
        return _with_numbers(_from_text(path, layout), told, is_proven=layout.is_proven)
    table = pa_parquet.ParquetFile(path).read()
    log = LogFile(path, tuple(name.strip() for name in table.column_names), table)
    return _with_numbers(log, told, is_proven=False)


def check_readable(path: Path) -> None:
    """Raise `InputError` where a file is missing or empty."""
    if not path.exists():
        near = difflib.get_close_matches(path.name, [p.name for p in path.parent.glob("*")], 1)
        hint = f"did you mean {path.parent / near[0]}?" if near else "check the path"
        raise input_error(path, "no such file", hint)
    if path.stat().st_size == 0:
        raise input_error(path, "is empty (0 bytes)", "was the recording stopped before it was saved?")


def _from_text(path: Path, layout: Layout) -> LogFile:
    units = {n: u for n, u in zip(layout.names, layout.units or (), strict=False) if n and u}
    table = _parse_rows(path, layout)
    return LogFile(
        path,
        layout.names,
        table,
        notes=layout.notes,
        keys=layout.keys,
        units=units,
        lines=layout.lines,
        decimal=layout.decimal,
    )


def _parse_rows(path: Path, layout: Layout) -> pa.Table:
    ragged: list[pa_csv.InvalidRow] = []

    def note_ragged(row: pa_csv.InvalidRow) -> str:
        ragged.append(row)
        return "skip"

    # Names stay out: a file may have one twice.
    names = [f"{number}" for number in range(len(layout.names))]
    if not layout.rows:
        return pa.table({name: pa.array([], pa.float64()) for name in names})
    text = "\n".join(layout.rows)
    # To Arrow 0x10 is a whole number.
    as_text = dict.fromkeys(names, pa.string()) if "0x" in text or "0X" in text else None
    table = pa_csv.read_csv(
        io.BytesIO(text.encode()),
        # Rows are only numbered when one thread reads them.
        read_options=pa_csv.ReadOptions(use_threads=False, column_names=names),
        parse_options=pa_csv.ParseOptions(
            delimiter=layout.separator, newlines_in_values=layout.has_wide_rows, invalid_row_handler=note_ragged
        ),
        convert_options=pa_csv.ConvertOptions(decimal_point=layout.decimal, column_types=as_text),
    )
    if table.num_rows + len(ragged) != len(layout.lines):
        # To Arrow a mark opens a cell only where the cell begins: it then has other rows than lines were counted.
        wide = next((i for i, row in enumerate(layout.rows) if "\n" in row), 0)
        raise input_error(
            f"{path}: line {layout.lines[wide]}",
            "has a quotation mark in a cell that does not end with one",
            'take the quotation marks (") of that line away, or close them',
        )
    if ragged:
        raise _ragged(path, layout, ragged)
    return table


def _ragged(path: Path, layout: Layout, ragged: list[pa_csv.InvalidRow]) -> InputError:
    separated = {"\t": "tabs", ";": "semicolons", "|": "bars"}.get(layout.separator, "commas")
    fix = f"the header is the first line; every row needs as many cells, separated by {separated}"
    mistakes = [
        Mistake(
            f"{path}: line {layout.lines[row.number - 1]}",
            f"has {row.actual_columns} cells where the header has {row.expected_columns}",
            fix,
        )
        for row in ragged[:_RAGGED_LINES_SHOWN]
    ]
    if len(ragged) > _RAGGED_LINES_SHOWN:
        mistakes.append(Mistake(str(path), f"{len(ragged)} lines in all are ragged"))
    doubled = [2 * row.expected_columns == row.actual_columns for row in ragged]
    if layout.separator == "," and all(doubled) and len(ragged) == len(layout.rows):
        mistakes.append(
            Mistake(
                str(path), "has commas for decimal marks and between columns", "save it with semicolons between"
            )
        )
    return InputError(*mistakes)


def _with_numbers(log: LogFile, told: FileFormat, *, is_proven: bool) -> LogFile:
    """Return a log whose columns of grouped digits or ISO 8601 dates, being text, are numbers and time stamps.

    Args:
        log: as the file has it.
        told: how it is to be read.
        is_proven: whether its decimal mark is sure.
    """
    columns, notes, keys = [], list(log.notes), dict(log.keys)
    grouped: list[str] = []
    for name, column in zip(log.names, log.table.columns, strict=True):
        if pa.types.is_string(column.type) or pa.types.is_large_string(column.type):
            cells = trimmed(column)
            dates = to_dates(cells)
            grouping = told.thousands or (grouping_of(cells, log.decimal) if dates is None else None)
            if dates is not None:
                column = dates
            elif grouping and not bad_numbers(cells, log.decimal, grouping).size:
                column = to_numbers(cells, log.decimal, grouping)
                grouped += [name] if told.thousands is None else []
                keys |= {"thousands": grouping} if told.thousands is None else {}
        columns.append(column)
    if grouped:
        is_proven = is_proven or keys["thousands"] not in ".,"
        if not is_proven and not any(pa.types.is_floating(column.type) for column in log.table.columns):
            mark = keys["thousands"]
            raise input_error(
                f"{log.path}: column {grouped[0]!r}",
                f"{mark!r} may group its digits or be its decimal mark, and no other cell tells which",
                f'set thousands = "{mark}" or decimal = "{mark}" in [file] of a signal map',
            )
        notes.append(
            f"digits grouped by {keys['thousands']!r} in {', '.join(map(repr, grouped))} (file.thousands)"
        )
    return replace(log, table=pa.table(columns, log.table.column_names), notes=tuple(notes), keys=keys)
