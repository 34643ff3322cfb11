"""The run folder: finished chunks that no crash can take back.

RUN/manifest.json         what is computed: study, hash, plan, seed, versions, list of chunks, hashes of its files
RUN/chunks/<id>.parquet   one finished chunk with its seal, written beside its place and renamed into it
RUN/results.parquet       all chunks in order
RUN/.lock                 who is at work on it
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from tuning.files.errors import InputError, input_error
from tuning.files.seal import (
    SEALED,
    bare,
    metadata_of,
    seal_tables,
)
from tuning.files.whole import write_tables, write_text
from tuning.runs.lock import NAME as LOCK
from tuning.runs.lock import FolderLock, lock_folder
from tuning.runs.manifest import edition_of, read_manifest, run_id, versions
from tuning.runs.sealed import AGAIN, columns_of, is_file, read_sealed, table_of, write_sealed
from tuning.study.base import Study, resolved, study_hash
from tuning.study.inputs import check_inputs, hash_inputs
from tuning.study.kinds import kind_of

_STRAYS = (".manifest.json.*.tmp", LOCK)
"""What a kill leaves of a manifest that was not yet in place, and of a process."""

_RESULTS = "results"

_ROWS_AT_ONCE = 1 << 16


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
        return self._write_results([table_of(columns)])

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
                raise input_error(self._place(chunk), problem, f"remove it; {AGAIN}")
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
            "edition": kind_of(study).edition,
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
    begun, now = edition_of(held), kind_of(study).edition
    if begun != now:
        problem = f"was begun by another version of vsajax: its answers are of edition {begun}, not {now}"
        fix = "name a new folder with -o; vsajax report still reads this one"
        raise input_error(folder, problem, fix)
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


def read_results(folder: Path) -> pa.Table:
    """Return the results of the run in a folder, if they are as the run joined them.

    Raises:
        InputError: they, or the run's manifest, cannot be read or have been changed.
    """
    manifest = read_manifest(folder / "manifest.json")
    path = folder / f"{_RESULTS}.parquet"
    return read_sealed(path, run_id(manifest), _RESULTS, needs_seal=SEALED in manifest)
