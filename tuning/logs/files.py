"""CSV and Parquet files: read so that a bad cell can be named, written whole or not at all."""

from __future__ import annotations

import difflib
import itertools
import math
import os
import uuid
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet

from tuning.errors import InputError, Mistake, input_error

SUFFIXES = (".csv", ".parquet")
_RAGGED_LINES_SHOWN = 5


@dataclass(frozen=True)
class LogFile:
    """The columns of a file, as they are.

    Args:
        path: the file.
        names: of the columns, in order; without the blanks around them.
        table: the columns.
        clock: the column of time stamps, where the format says which that is.
    """

    path: Path
    names: tuple[str, ...]
    table: pa.Table
    clock: str | None = None

    def column(self, name: str) -> pa.ChunkedArray:
        """Return the first column of this name."""
        column = self.table.column(self.names.index(name))
        return column.cast(column.type.value_type) if pa.types.is_dictionary(column.type) else column

    def place(self, row: int) -> str:
        """Return where a user finds a row (from 0): a line of a CSV, a row (from 1) of a Parquet file."""
        is_csv = self.path.suffix.lower() == ".csv"
        return f"line {_line_of(self.path, row)}" if is_csv else f"row {row + 1}"

    def nearest(self, name: str) -> str | None:
        """Return the column whose name is most like `name`, capitals apart, if any is."""
        by_lower = {known.lower(): known for known in self.names}
        near = difflib.get_close_matches(name.lower(), by_lower, 1)
        return by_lower[near[0]] if near else None

    def numbers(self, name: str, rows: np.ndarray) -> np.ndarray:
        """Return a column at `rows` as finite numbers: int64 where the file holds integers, else float64.

        Raises:
            InputError: cells are not numbers, empty, NaN or infinite; names the first.
        """
        column = self.column(name).take(pa.array(rows))
        held = column.type
        if pa.types.is_integer(held) and column.null_count == 0:
            return column.to_numpy().astype(np.int64)
        if pa.types.is_integer(held) or pa.types.is_floating(held) or pa.types.is_decimal(held):
            values = column.cast(pa.float64(), safe=False).to_numpy()
        elif pa.types.is_null(held):
            values = np.full(len(rows), np.nan)
        elif pa.types.is_string(held) or pa.types.is_large_string(held) or pa.types.is_binary(held):
            values = self._parse(name, column.to_pylist(), rows)
        else:
            raise input_error(
                self.path, f"column {name!r} holds {held} values, not numbers", "write it as numbers"
            )
        lost = np.flatnonzero(~np.isfinite(values))
        if lost.size:
            got = "no value or NaN" if math.isnan(values[lost[0]]) else f"{values[lost[0]]}"
            raise self._bad_cells(name, got, "a finite number", rows[lost])
        return values

    def _parse(self, name: str, cells: list[str | bytes | None], rows: np.ndarray) -> np.ndarray:
        values, bad = np.full(len(cells), np.nan), []
        for i, cell in enumerate(cells):
            try:
                values[i] = math.nan if cell is None else float(cell)
            except ValueError:
                bad.append(i)
        if bad:
            raise self._bad_cells(name, repr(cells[bad[0]]), "a number", rows[bad])
        return values

    def _bad_cells(self, name: str, got: str, wanted: str, rows: np.ndarray) -> InputError:
        more = f" ({rows.size} such rows in all)" if rows.size > 1 else ""
        return input_error(
            f"{self.path}: {self.place(rows[0])}",
            f"column {name!r} has {got} where {wanted} is needed{more}",
            "cut those rows out, or mend them",
        )


def read_log_file(path: Path) -> LogFile:
    """Return the columns of a CSV (comma, one header row, UTF-8) or Parquet file.

    Raises:
        InputError: the file is missing, a directory, empty, unreadable, of another format, or ragged.
    """
    try:
        table = _read_table(path)
        names = tuple(name.strip() for name in table.column_names)
    except UnicodeDecodeError as error:
        raise input_error(path, f"has a header that is not UTF-8 ({error.reason})", "save it as UTF-8") from None
    except pa.ArrowException as error:
        what = {".csv": "a CSV file", ".parquet": "a Parquet file"}[path.suffix.lower()]
        raise input_error(path, f"cannot be read as {what}: {error}", "was it cut short or misnamed?") from None
    except OSError as error:
        reason = error.strerror or str(error)
        raise input_error(
            path, f"cannot be read ({reason})", "check its permissions and that it is whole"
        ) from None
    if table.num_rows == 0:
        raise input_error(path, "has a header but no samples", "was the recording stopped before it was saved?")
    return LogFile(path, names, table)


def _read_table(path: Path) -> pa.Table:
    if path.is_dir():
        raise input_error(path, "is a directory", "name a file in it")
    suffix = table_suffix(path)
    check_readable(path)
    return _read_csv(path) if suffix == ".csv" else pa_parquet.ParquetFile(path).read()


def check_readable(path: Path) -> None:
    """Raise `InputError` where a file is missing or empty."""
    if not path.exists():
        near = difflib.get_close_matches(path.name, [p.name for p in path.parent.glob("*")], 1)
        hint = f"did you mean {path.parent / near[0]}?" if near else "check the path"
        raise input_error(path, "no such file", hint)
    if path.stat().st_size == 0:
        raise input_error(path, "is empty (0 bytes)", "was the recording stopped before it was saved?")


def table_suffix(path: Path) -> str:
    """Return the suffix of a table file, or raise `InputError` where it is neither CSV nor Parquet."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise input_error(path, f"unknown suffix {suffix!r}; known are {', '.join(SUFFIXES)}", "convert it to one")
    return suffix


def _line_of(path: Path, row: int) -> int:
    """Return the line (from 1) of a CSV that holds a row of data (from 0)."""
    # The reader skips blank lines; an editor counts them.
    with path.open("rb") as lines:
        filled = (number for number, line in enumerate(lines, 1) if line.strip(b"\r\n"))
        return next(itertools.islice(filled, row + 1, None))


def _is_text(path: Path) -> bool:
    try:
        path.read_bytes().decode("utf-8")
    except UnicodeDecodeError:
        return False
    return True


def _read_csv(path: Path) -> pa.Table:
    ragged: list[pa_csv.InvalidRow] = []

    def note_ragged(row: pa_csv.InvalidRow) -> str:
        ragged.append(row)
        return "skip"

    try:
        table = pa_csv.read_csv(
            path,
            # Rows are only numbered when one thread reads them.
            read_options=pa_csv.ReadOptions(use_threads=False),
            # The handler is handed text: of other bytes the parser itself must complain.
            parse_options=pa_csv.ParseOptions(invalid_row_handler=note_ragged if _is_text(path) else None),
        )
    except pa.ArrowInvalid as error:
        if "Empty CSV" in str(error):
            raise input_error(path, "has no samples", "a header row and one row per sample are needed") from None
        raise
    separator = next((mark for mark in ";\t" if mark in table.column_names[0]), None)
    if table.num_columns == 1 and separator:
        raise input_error(
            path, f"is separated by {separator!r}, not by commas", "save it with commas and decimal points"
        )
    if ragged:
        fix = "the header is the first line; every row needs as many cells, separated by commas"
        mistakes = [
            Mistake(
                f"{path}: line {_line_of(path, row.number - 2)}",
                f"has {row.actual_columns} cells where the header has {row.expected_columns}",
                fix,
            )
            for row in ragged[:_RAGGED_LINES_SHOWN]
        ]
        if len(ragged) > _RAGGED_LINES_SHOWN:
            mistakes.append(Mistake(str(path), f"{len(ragged)} lines in all are ragged"))
        raise InputError(*mistakes)
    return table


def write_table(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    """Write columns to a CSV or Parquet file, whole or not at all; a CSV gives back the same float64 values.

    Args:
        path: the file; its folder is made if need be.
        columns: by name, one-dimensional and of one length.

    Raises:
        InputError: the suffix is unknown, or the file cannot be written there.
    """
    suffix = table_suffix(path)
    table = pa.table({name: np.asarray(values) for name, values in columns.items()})
    # In the same folder, so that the last step is a rename within one file system.
    partial = path.with_name(f".{path.name}.{os.getpid()}-{uuid.uuid4().hex[:8]}.partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            if suffix == ".csv":
                pa_csv.write_csv(table, partial)
            else:
                pa_parquet.write_table(table, partial)
            os.replace(partial, path)
        finally:
            partial.unlink(missing_ok=True)
    except OSError as error:
        reason = error.strerror or str(error)
        raise input_error(path, f"cannot be written ({reason})", "choose another place") from None
