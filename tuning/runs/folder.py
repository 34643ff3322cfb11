"""The run folder: finished chunks that no crash can take back.

RUN/manifest.json         what is computed: study, hash, plan, seed, versions, list of chunks, hashes of its files
RUN/chunks/<id>.parquet   one finished chunk with its seal, written beside its place and renamed into it
RUN/results.parquet       all chunks in order
RUN/.lock                 who is at work on it
"""

from __future__ import annotations

import json
import os
import platform
import stat
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatch
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tuning.files.errors import InputError, input_error
from tuning.files.seal import (
    KEY,
    SEALED,
    bare,
    breaks_seal,
    fault,
    hash_tables,
    is_sealed,
    metadata_of,
    seal_tables,
    sealed,
)
from tuning.files.whole import write_tables, write_text
from tuning.runs.lock import NAME as LOCK
from tuning.runs.lock import FolderLock, lock_folder
from tuning.study.base import Base, Study, hash_resolved, resolved, study_hash
from tuning.study.foreign import foreign_in
from tuning.study.inputs import check_inputs, hash_inputs

_LEGACY = {
    "command": str,
    "study_hash": str,
    "plan": dict,
    "seed": int,
    "study": dict,
    "chunks": list,
    "versions": dict,
}
"""Keys and types of a manifest from before there were seals."""
_KEYS = _LEGACY | {"files": dict, SEALED: str}
_STRAYS = (".manifest.json.*.tmp", LOCK)
"""What a kill leaves of a manifest that was not yet in place, and of a process."""
_RESULTS = "results"
_ROWS_AT_ONCE = 1 << 16
_AGAIN = "--resume computes it again"


@dataclass(frozen=True)
class RunStore:
    """A run folder and its manifest.

    Args:
        folder: the run folder.
        manifest: its contents, as in `manifest.json`.
        lock: keeps other processes out of the folder as long as there is a store of it.
    """

    folder: Path
    manifest: Mapping[str, Any]
    lock: FolderLock | None = None

    @property
    def chunks(self) -> list[str]:
        """The ids of all chunks, in order."""
        return list(self.manifest["chunks"])

    @property
    def run(self) -> str:
        """What its chunks are sealed with: a hash of all that determines them."""
        return run_id(self.manifest)

    @property
    def is_sealed(self) -> bool:
        """Whether every chunk must carry a seal; runs begun before there were seals have chunks without."""
        return SEALED in self.manifest

    def pending(self) -> Iterator[str]:
        """Yield the ids of the chunks that are not finished, in order; see `is_finished`."""
        return (chunk for chunk in self.chunks if not self.is_finished(chunk))

    def is_finished(self, chunk: str) -> bool:
        """Return whether a chunk is there as it was written.

        One that cannot be read, is damaged or edited, or is another's, is not: stderr says so, and why.

        Raises:
            InputError: in its place is something that is no file, e.g. a directory or a pipe.
        """
        path = self._place(chunk)
        if not is_file(path):
            return False
        try:
            self._read(chunk)
        except InputError as error:
            problem = "; ".join(mistake.problem for mistake in error.mistakes)
            print(f"note: {path} {problem}; it is computed again", file=sys.stderr)
            return False
        return True

    def write_chunk(self, chunk: str, columns: Mapping[str, np.ndarray]) -> None:
        """Keep a finished chunk.

        Raises:
            InputError: it cannot be written, e.g. as the disk is full; the chunk stays pending.
        """
        write_sealed(self._place(chunk), columns, self.run, chunk)

    def read_chunk(self, chunk: str) -> dict[str, np.ndarray]:
        """Return the columns of a finished chunk.

        Raises:
            InputError: it cannot be read, or is not as it was written.
        """
        return columns_of(self._read(chunk))

    def computed(self, chunk: str, compute: Callable[[], Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
        """Return the columns of a chunk, which is computed and kept first if it is not finished.

        Raises:
            InputError: it cannot be written.
        """
        if not self.is_finished(chunk):
            self.write_chunk(chunk, compute())
        return self.read_chunk(chunk)

    def finish(self) -> Path:
        """Join all chunks into `results.parquet`, holding few of them at a time, and return where it is.

        Raises:
            InputError: it cannot be written, or a chunk has become unreadable or another.
        """
        return self._write_results(self._tables())

    def write_results(self, columns: Mapping[str, np.ndarray]) -> Path:
        """Write `results.parquet` of a run without chunks, and return where it is.

        Raises:
            InputError: it cannot be written.
        """
        return self._write_results([_table_of(columns)])

    def _write_results(self, tables: Iterable[pa.Table]) -> Path:
        path = self.folder / f"{_RESULTS}.parquet"
        if path.exists():
            is_file(path)
        write_tables(path, tables, lambda digest: metadata_of(digest.seal(self.run, _RESULTS)))
        return path

    def _tables(self) -> Iterator[pa.Table]:
        """Yield all rows in order, cut in the same places however the chunks came about."""
        held: list[pa.Table] = []
        first: pa.Schema | None = None
        for chunk in self.chunks:
            table = bare(self._read(chunk))
            first = first or table.schema
            if not table.schema.equals(first):
                problem = f"has other columns than {self._place(self.chunks[0]).name}"
                raise input_error(self._place(chunk), problem, f"remove it; {_AGAIN}")
            held.append(table)
            if sum(table.num_rows for table in held) >= _ROWS_AT_ONCE:
                yield pa.concat_tables(held)
                held = []
        if held:
            yield pa.concat_tables(held)

    def _read(self, chunk: str) -> pa.Table:
        path = self._place(chunk)
        return read_sealed(path, self.run, chunk, needs_seal=self.is_sealed)

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
        InputError: the folder holds another run, or this one without `resume`, or files of something else; its
            manifest is damaged; a file that the study names has changed; another process is at work on it.
    """
    path = folder / "manifest.json"
    identity = {"command": command, "study_hash": study_hash(study), "plan": dict(plan)}
    _refuse_foreign(folder)
    files = {} if os.path.lexists(path) else hash_inputs(study)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise input_error(path, f"cannot be written ({error.strerror})", "check the folder and the disk") from None
    lock = lock_folder(folder)
    try:
        if os.path.lexists(path):
            return RunStore(folder, _resumed(path, identity, study, chunks, resume=resume), lock)
        manifest = identity | {
            "seed": study.seed,
            "study": resolved(study),
            "chunks": chunks,
            "versions": versions(study),
            "files": files,
        }
        manifest = seal_tables(json.loads(json.dumps(manifest)))
        write_text(path, json.dumps(manifest, indent=2) + "\n")
        for stray in folder.glob(_STRAYS[0]):
            stray.unlink(missing_ok=True)
        return RunStore(folder, manifest, lock)
    except BaseException:
        # Else the error's traceback would hold it.
        del lock
        raise


def _refuse_foreign(folder: Path) -> None:
    """Refuse what is no folder, and one that holds files but no run."""
    if folder.exists() and not folder.is_dir():
        raise input_error(folder, "is a file, not a run folder", "name another folder with -o")
    held = [path.name for path in folder.iterdir()] if folder.exists() else []
    if "manifest.json" not in held and any(not _is_stray(name) for name in held):
        raise input_error(folder, "is not empty and holds no run", "name a new or empty folder with -o")


def _is_stray(name: str) -> bool:
    return any(fnmatch(name, pattern) for pattern in _STRAYS)


def _resumed(
    path: Path, identity: Mapping[str, Any], study: Study, chunks: list[str], *, resume: bool
) -> dict[str, Any]:
    """Return the manifest of a run that goes on, if it is the one that is asked for."""
    folder, held = path.parent, read_manifest(path)
    differing = [key for key in identity if held[key] != identity[key]]
    if differing:
        what = " and ".join(f"{key} ({held[key]!s:.60} there)" for key in differing)
        raise input_error(folder, f"holds another run: it differs in {what}", "name a new folder with -o")
    if not resume:
        raise input_error(folder, "holds this run already", "go on with --resume, or name a new folder")
    if held["chunks"] != chunks:
        problem = f"lists {len(held['chunks'])} chunks, not the {len(chunks)} into which this version cuts the run"
        raise input_error(f"{path}: chunks", problem, "name a new folder with -o")
    if SEALED not in held:
        print(f"note: {folder} was begun before runs were sealed: what it holds is not verified", file=sys.stderr)
    check_inputs(held.get("files", {}), study, folder)
    return held


def read_manifest(path: Path) -> dict[str, Any]:
    """Return a manifest that is whole.

    Raises:
        InputError: it cannot be read, lacks a key, has one too many or one of another type, or has been changed
            since it was written.
    """
    way_out = "put the manifest back as it was, or name a new folder with -o"
    try:
        if not is_file(path):
            raise input_error(path, "no such file", way_out)
        held = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError, RecursionError) as error:
        raise input_error(path, f"cannot be read as a manifest ({error})", way_out) from None
    if not isinstance(held, dict):
        raise input_error(path, f"cannot be read as a manifest (got {held!s:.40})", way_out)
    missing = [key for key in _LEGACY if key not in held]
    if missing:
        raise input_error(path, f"cannot be read as a manifest (it lacks {', '.join(missing)})", way_out)
    for key, value in held.items():
        if key not in _KEYS:
            raise input_error(f"{path}: {key!s:.40}", "unknown key", way_out)
        wanted = _KEYS[key]
        if not isinstance(value, wanted) or isinstance(value, bool):
            raise input_error(f"{path}: {key}", f"got {value!s:.40}, not a {_JSON[wanted]}", way_out)
    if not all(isinstance(chunk, str) for chunk in held["chunks"]):
        raise input_error(f"{path}: chunks", "got ids that are no strings", way_out)
    if (found := hash_resolved(held["study"])) != held["study_hash"]:
        problem = f"has been changed: its hash is {found}, but study_hash says {held['study_hash']!s:.40}"
        raise input_error(f"{path}: study", problem, way_out)
    if ("files" in held or SEALED in held) and breaks_seal(held):
        problem = "has been changed since it was written: it breaks its seal"
        raise input_error(path, problem, way_out)
    return held


_JSON = {str: "string", dict: "object", list: "list", int: "whole number"}


def run_id(manifest: Mapping[str, Any]) -> str:
    """Return a hash of all that determines a run's results: command, study, plan, and the files that they name."""
    identity = {key: manifest[key] for key in ("command", "study_hash", "plan")}
    return hash_tables(identity | {"files": manifest.get("files", {})})[:32]


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


_KINDS = {
    stat.S_ISDIR: "a directory",
    stat.S_ISFIFO: "a pipe",
    stat.S_ISSOCK: "a socket",
    stat.S_ISCHR: "a device",
    stat.S_ISBLK: "a device",
}


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
            raise input_error(path, problem, _AGAIN)
    return table


def read_results(folder: Path) -> pa.Table:
    """Return the results of the run in a folder, if they are as the run joined them.

    Raises:
        InputError: they, or the run's manifest, cannot be read or have been changed.
    """
    manifest = read_manifest(folder / "manifest.json")
    path = folder / f"{_RESULTS}.parquet"
    return read_sealed(path, run_id(manifest), _RESULTS, needs_seal=SEALED in manifest)


def columns_of(table: pa.Table) -> dict[str, np.ndarray]:
    """Return the columns of a table by name."""
    return {name: table[name].to_numpy() for name in table.column_names}


def write_sealed(path: Path, columns: Mapping[str, np.ndarray], run: str, chunk: str) -> None:
    """Write a chunk of a run with its seal, whole or not at all.

    Raises:
        InputError: it cannot be written.
    """
    write_tables(path, [sealed(_table_of(columns), run, chunk)])


def _table_of(columns: Mapping[str, np.ndarray]) -> pa.Table:
    return pa.table({name: np.asarray(values) for name, values in columns.items()})


def _first_line(error: BaseException) -> str:
    return str(error).strip().partition("\n")[0][:200] or type(error).__name__


def versions(config: Base | None = None) -> dict[str, str]:
    """Return the versions of all that results depend on: those of a configuration, on its plug-ins too."""
    packages = ("vsajax", "jax", "jaxlib", "equinox", "optimistix", "numpy", "scipy")
    own = {"python": platform.python_version()} | {name: metadata.version(name) for name in packages}
    foreign = {} if config is None else foreign_in(config)
    return own | {record["name"]: record["version"] for record in foreign.values()}


def read_table(path: Path) -> pa.Table:
    """Return a Parquet file that a run has written.

    Raises:
        InputError: it cannot be read.
    """
    if not is_file(path):
        raise input_error(path, "no such file", _AGAIN)
    try:
        with pq.ParquetFile(path) as file:
            # What is added to a file once its rows are known is not in its schema.
            held = (file.metadata.metadata or {}).get(KEY)
            return file.read().replace_schema_metadata(None if held is None else {KEY: held})
    except (OSError, ValueError, TypeError, OverflowError, MemoryError, pa.ArrowException) as error:
        raise input_error(path, f"cannot be read ({_first_line(error)})", _AGAIN) from None
