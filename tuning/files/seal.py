"""Seals: whose work a file of a run is, and that it still holds what was written.

A seal tells damage and mix-ups; it is no signature, and stops nobody who means to forge one. The one of a table
lies in the metadata of its Parquet schema, the one of a JSON object under its key `sealed`.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import pyarrow as pa

KEY = b"vsajax.seal"
"""Of a table's seal among its metadata."""
SEALED = "sealed"
"""Of a JSON object's own hash among its keys."""


@dataclass(frozen=True)
class Seal:
    """What a file says of itself.

    Args:
        run: hash of all that determines the run's results.
        chunk: id of the chunk; "results" for all of them joined.
        rows: of the table.
        sha256: of the table's contents: names, types and values of its columns.
    """

    run: str
    chunk: str
    rows: int
    sha256: str


class Digest:
    """SHA-256 of a table's contents, fed in parts; where it is cut does not matter.

    It covers names, types, order and every bit of the values, and nothing that Parquet is free to choose, such as
    pages, statistics or compression.
    """

    def __init__(self):
        self.rows = 0
        self._fields: list[tuple[str, str]] | None = None
        self._columns: list[Any] = []

    def update(self, table: pa.Table) -> None:
        """Add rows.

        Raises:
            ValueError: their columns are others than those before them.
        """
        fields = _fields(table)
        if self._fields is None:
            self._fields, self._columns = fields, [hashlib.sha256() for _ in fields]
        if fields != self._fields:
            raise ValueError("columns of other names or types")
        for digest, column in zip(self._columns, table.columns, strict=True):
            for part in column.chunks:
                digest.update(_contents(part))
        self.rows += table.num_rows

    def hexdigest(self) -> str:
        """Return the hash of all rows so far."""
        whole = hashlib.sha256(json.dumps([self._fields, self.rows]).encode())
        for digest in self._columns:
            whole.update(digest.digest())
        return whole.hexdigest()

    def seal(self, run: str, chunk: str) -> Seal:
        """Return the seal of all rows so far."""
        return Seal(run, chunk, self.rows, self.hexdigest())


def sealed(table: pa.Table, run: str, chunk: str) -> pa.Table:
    """Return a table with the seal of a chunk of a run."""
    return table.replace_schema_metadata(metadata_of(_seal_of(table, run, chunk)))


def metadata_of(seal: Seal) -> dict[bytes, bytes]:
    """Return the metadata in which a table carries a seal."""
    return {KEY: json.dumps(asdict(seal), sort_keys=True).encode()}


def is_sealed(metadata: Mapping[bytes, bytes] | None) -> bool:
    """Return whether a table's metadata carry a seal, be it whole or broken."""
    return KEY in (metadata or {})


def fault(table: pa.Table, metadata: Mapping[bytes, bytes] | None, run: str, chunk: str) -> str:
    """Return what is wrong with a table that should be a chunk of a run; empty where nothing is."""
    if not is_sealed(metadata):
        return "carries no seal"
    try:
        held = Seal(**json.loads((metadata or {})[KEY]))
    except (ValueError, TypeError):
        return "carries a broken seal"
    if held.run != run:
        return "is of another run"
    if held.chunk != chunk:
        return f"is a copy of {held.chunk!s:.40}"
    if held.rows != table.num_rows:
        return f"has {table.num_rows} rows, not the {held.rows!s:.20} that its seal says"
    return "" if held == _seal_of(table, run, chunk) else "does not hold what was written: it breaks its seal"


def bare(table: pa.Table) -> pa.Table:
    """Return the columns of a table alone, without seals or notes of whoever wrote it."""
    return pa.Table.from_arrays(table.columns, names=table.column_names)


def seal_tables(tables: Mapping[str, Any]) -> dict[str, Any]:
    """Return a JSON object with its own hash under the key `sealed`."""
    return dict(tables) | {SEALED: hash_tables(tables)}


def breaks_seal(tables: Mapping[str, Any]) -> bool:
    """Return whether a JSON object's hash is not that of its contents."""
    return tables.get(SEALED) != hash_tables({key: value for key, value in tables.items() if key != SEALED})


def hash_tables(tables: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a JSON object; the order of its keys does not matter."""
    return hashlib.sha256(json.dumps(tables, sort_keys=True).encode()).hexdigest()


def hash_bytes(parts: Iterable[bytes]) -> str:
    """Return the SHA-256 of bytes that come in parts."""
    whole = hashlib.sha256()
    for part in parts:
        whole.update(part)
    return whole.hexdigest()


def _seal_of(table: pa.Table, run: str, chunk: str) -> Seal:
    digest = Digest()
    digest.update(table)
    return digest.seal(run, chunk)


def _fields(table: pa.Table) -> list[tuple[str, str]]:
    return [(field.name, str(field.type)) for field in table.schema]


def _contents(array: pa.Array) -> Any:
    """Return the values of an array as bytes; those of numbers are not copied."""
    is_number = pa.types.is_integer(array.type) or pa.types.is_floating(array.type)
    if is_number and array.null_count == 0:
        values = array.to_numpy(zero_copy_only=False)
        return memoryview(np.ascontiguousarray(values, values.dtype.newbyteorder("<"))).cast("B")
    return "".join(f"{value!r}\n" for value in array.to_pylist()).encode("utf-8", "surrogatepass")
