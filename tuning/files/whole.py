"""Files that are written whole or not at all."""

from __future__ import annotations

import itertools
import os
import uuid
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet

from tuning.files.errors import input_error
from tuning.files.seal import (
    Digest,
)

SUFFIXES = (".csv", ".parquet")
"""What is written; text is read by other names too."""


def table_suffix(path: Path, known: Sequence[str] = SUFFIXES) -> str:
    """Return the suffix of a table file, or raise `InputError` where it is none of those known."""
    suffix = path.suffix.lower()
    if suffix not in known:
        raise input_error(path, f"unknown suffix {suffix!r}; known are {', '.join(known)}", "use one of them")
    return suffix


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


def write_tables(
    path: Path, tables: Iterable[pa.Table], closing: Callable[[Digest], dict[bytes, bytes]] | None = None
) -> None:
    """Write tables of one schema, one after another, to a Parquet file: whole or not at all.

    Args:
        path: the file.
        tables: its rows.
        closing: the metadata that the file gets once all rows are known.
    """
    beside = path.with_name(f".{path.name}.{os.getpid()}-{uuid.uuid4().hex[:8]}.partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            rest = iter(tables)
            first = next(rest)
            digest = Digest()
            with pa_parquet.ParquetWriter(beside, first.schema) as writer:
                for table in itertools.chain([first], rest):
                    writer.write_table(table)
                    if closing:
                        digest.update(table)
                if closing:
                    writer.add_key_value_metadata(closing(digest))
            _put_in_place(beside, path)
        finally:
            beside.unlink(missing_ok=True)
    except OSError as error:
        # pyarrow words the reason in its own way.
        problem = f"cannot be written ({os.strerror(error.errno) if error.errno else error})"
        raise input_error(path, problem, "make room there, then go on with --resume") from None


def write_text(path: Path, text: str) -> None:
    """Write a text file so that a crash leaves either the old file or the new one, never half of one.

    Raises:
        InputError: the file cannot be written there.
    """
    write_bytes(path, text.encode())


def write_bytes(path: Path, contents: bytes) -> None:
    """Write a file as `write_text` does."""
    beside = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            beside.write_bytes(contents)
            _put_in_place(beside, path)
        finally:
            beside.unlink(missing_ok=True)
    except OSError as error:
        raise input_error(path, f"cannot be written ({error.strerror})", "check the folder and the disk") from None


def _put_in_place(beside: Path, path: Path) -> None:
    """Rename a file once it is on the disk: a machine that goes down must not leave a name without contents."""
    with beside.open("rb") as written:
        os.fsync(written.fileno())
    os.replace(beside, path)
