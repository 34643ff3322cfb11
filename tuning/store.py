"""The run folder: finished chunks that no crash can take back.

RUN/manifest.json         what is computed: study, hash, plan, seed, versions, list of chunks
RUN/chunks/<id>.parquet   one finished chunk, written beside its place and renamed into it
RUN/results.parquet       all chunks in order
"""

from __future__ import annotations

import itertools
import json
import os
import platform
import uuid
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tuning.errors import input_error
from tuning.study import Study, resolved, study_hash

_IDENTITY = ("command", "study_hash", "plan")
_STRAYS = ".manifest.json.*.tmp"
"""What a kill leaves of a manifest that was not yet in place."""
_ROWS_AT_ONCE = 1 << 16


@dataclass(frozen=True)
class RunStore:
    """A run folder and its manifest.

    Args:
        folder: the run folder.
        manifest: its contents, as in `manifest.json`.
    """

    folder: Path
    manifest: Mapping[str, Any]

    @property
    def chunks(self) -> list[str]:
        """The ids of all chunks, in order."""
        return list(self.manifest["chunks"])

    def pending(self) -> Iterator[str]:
        """Yield the ids of the chunks that are not finished, in order.

        A chunk that cannot be read, for the machine went down before it was on the disk, is not.
        """
        return (chunk for chunk in self.chunks if not _is_whole(self._place(chunk)))

    def write_chunk(self, chunk: str, columns: Mapping[str, np.ndarray]) -> None:
        """Keep a finished chunk.

        Raises:
            InputError: it cannot be written, e.g. as the disk is full; the chunk stays pending.
        """
        _write_tables(self._place(chunk), [pa.table({name: np.asarray(v) for name, v in columns.items()})])

    def finish(self) -> Path:
        """Join all chunks into `results.parquet`, holding few of them at a time, and return where it is.

        Raises:
            InputError: it cannot be written, or a chunk has become unreadable.
        """
        path = self.folder / "results.parquet"
        _write_tables(path, self._tables())
        return path

    def _tables(self) -> Iterator[pa.Table]:
        """Yield all rows in order, cut in the same places however the chunks came about."""
        held: list[pa.Table] = []
        for chunk in self.chunks:
            held.append(read_table(self._place(chunk)))
            if sum(table.num_rows for table in held) >= _ROWS_AT_ONCE:
                yield pa.concat_tables(held)
                held = []
        if held:
            yield pa.concat_tables(held)

    def _place(self, chunk: str) -> Path:
        return self.folder / "chunks" / f"{chunk}.parquet"


def open_run(
    folder: Path, command: str, study: Study, plan: Mapping[str, Any], chunks: list[str], *, resume: bool
) -> RunStore:
    """Return the store of a new run, or of one that goes on.

    Args:
        folder: the run folder; made if need be.
        command: the command that runs.
        study: what it runs on.
        plan: all else that determines the results.
        chunks: ids of the chunks, in order.
        resume: go on with what the folder holds, where that is the same run.

    Raises:
        InputError: the folder holds another run, or this one without `resume`, or files of something else.
    """
    identity = {"command": command, "study_hash": study_hash(study), "plan": dict(plan)}
    path = folder / "manifest.json"
    if folder.exists() and not folder.is_dir():
        raise input_error(folder, "is a file, not a run folder", "name another folder with -o")
    if path.exists():
        held = _read_manifest(path)
        differing = [key for key in _IDENTITY if held.get(key) != identity[key]]
        if differing:
            what = " and ".join(f"{key} ({held.get(key)!s:.60} there)" for key in differing)
            raise input_error(folder, f"holds another run: it differs in {what}", "name a new folder with -o")
        if not resume:
            raise input_error(folder, "holds this run already", "go on with --resume, or name a new folder")
        return RunStore(folder, held)
    if folder.exists() and any(not held.match(_STRAYS) for held in folder.iterdir()):
        raise input_error(folder, "is not empty and holds no run", "name a new or empty folder with -o")
    manifest = identity | {
        "seed": study.seed,
        "study": resolved(study),
        "chunks": chunks,
        "versions": versions(),
    }
    write_text(path, json.dumps(manifest, indent=2) + "\n")
    for stray in folder.glob(_STRAYS):
        stray.unlink(missing_ok=True)
    return RunStore(folder, manifest)


def _read_manifest(path: Path) -> dict[str, Any]:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise input_error(path, f"cannot be read as a manifest ({error})", "name a new folder with -o") from None


def read_table(path: Path) -> pa.Table:
    """Return a Parquet file that a run has written.

    Raises:
        InputError: it cannot be read.
    """
    try:
        with pq.ParquetFile(path) as file:
            return file.read()
    except (OSError, pa.ArrowException) as error:
        raise input_error(path, f"cannot be read ({error})", "--resume computes it again") from None


def _is_whole(path: Path) -> bool:
    try:
        read_table(path)
    except ValueError:
        return False
    return True


def _write_tables(path: Path, tables: Iterable[pa.Table]) -> None:
    """Write tables of one schema, one after another, to a Parquet file: whole or not at all."""
    beside = path.with_name(f".{path.name}.{os.getpid()}-{uuid.uuid4().hex[:8]}.partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            rest = iter(tables)
            first = next(rest)
            with pq.ParquetWriter(beside, first.schema) as writer:
                for table in itertools.chain([first], rest):
                    writer.write_table(table)
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


def versions() -> dict[str, str]:
    """Return the versions of all that results depend on."""
    packages = ("vsajax", "jax", "jaxlib", "equinox", "optimistix", "numpy", "scipy")
    return {"python": platform.python_version()} | {name: metadata.version(name) for name in packages}
