"""Files of a run as tables: written whole with a seal, read only as they were written."""

from __future__ import annotations

import stat
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tuning.files.errors import input_error
from tuning.files.seal import (
    KEY,
    fault,
    is_sealed,
    sealed,
)
from tuning.files.whole import write_tables

AGAIN = "--resume computes it again"
"""The way out where a file of a run is not as it was written."""

_KINDS = {
    stat.S_ISDIR: "a directory",
    stat.S_ISFIFO: "a pipe",
    stat.S_ISSOCK: "a socket",
    stat.S_ISCHR: "a device",
    stat.S_ISBLK: "a device",
}


def read_table(path: Path) -> pa.Table:
    """Return a Parquet file that a run has written.

    Raises:
        InputError: it cannot be read.
    """
    if not is_file(path):
        raise input_error(path, "no such file", AGAIN)
    try:
        with pq.ParquetFile(path) as file:
            # What is added to a file once its rows are known is not in its schema.
            held = (file.metadata.metadata or {}).get(KEY)
            return file.read().replace_schema_metadata(None if held is None else {KEY: held})
    except (OSError, ValueError, TypeError, OverflowError, MemoryError, pa.ArrowException) as error:
        raise input_error(path, f"cannot be read ({_first_line(error)})", AGAIN) from None


def read_sealed(path: Path, run: str, chunk: str, *, needs_seal: bool = True) -> pa.Table:
    """Return a chunk of a run, if it is as it was written.

    Args:
        path: its file.
        run: what it should be sealed with.
        chunk: its id.
        needs_seal: refuse it without a seal; a seal that is there is checked in any case.

    Raises:
        InputError: it cannot be read, or its seal is missing, broken, or another's.
    """
    table = read_table(path)
    if needs_seal or is_sealed(table.schema.metadata):
        try:
            problem = fault(table, table.schema.metadata, run, chunk)
        except (ValueError, pa.ArrowException) as error:
            problem = f"cannot be read ({_first_line(error)})"
        if problem:
            raise input_error(path, problem, AGAIN)
    return table


def write_sealed(path: Path, columns: Mapping[str, np.ndarray], run: str, chunk: str) -> None:
    """Write a chunk of a run with its seal, whole or not at all.

    Raises:
        InputError: it cannot be written.
    """
    write_tables(path, [sealed(table_of(columns), run, chunk)])


def columns_of(table: pa.Table) -> dict[str, np.ndarray]:
    """Return the columns of a table by name."""
    return {name: table[name].to_numpy() for name in table.column_names}


def table_of(columns: Mapping[str, np.ndarray]) -> pa.Table:
    """Return columns by name as a table."""
    return pa.table({name: np.asarray(values) for name, values in columns.items()})


def is_file(path: Path) -> bool:
    """Return whether there is a file.

    Raises:
        InputError: there is something else, such as a directory or a pipe, which opening might wait for.
    """
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return False
    except OSError as error:
        raise input_error(path, f"cannot be read ({error.strerror})", "check the folder, then --resume") from None
    if not stat.S_ISREG(mode):
        kind = next((name for is_kind, name in _KINDS.items() if is_kind(mode)), "no file")
        raise input_error(path, f"is {kind}, not a file", "remove it, then go on with --resume")
    return True


def _first_line(error: BaseException) -> str:
    return str(error).strip().partition("\n")[0][:200] or type(error).__name__
