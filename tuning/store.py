"""The run folder: finished chunks that no crash can take back.

RUN/manifest.json         what is computed: study, hash, plan, seed, versions, list of chunks
RUN/chunks/<id>.parquet   one finished chunk, written beside its place and renamed into it
RUN/results.parquet       all chunks in order
"""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tuning.errors import input_error
from tuning.log_files import write_table
from tuning.study import Study, resolved, study_hash

_IDENTITY = ("command", "study_hash", "plan")


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
        """Yield the ids of the chunks that are not finished, in order."""
        return (chunk for chunk in self.chunks if not self._place(chunk).exists())

    def write_chunk(self, chunk: str, columns: Mapping[str, np.ndarray]) -> None:
        """Keep a finished chunk."""
        write_table(self._place(chunk), columns)

    def finish(self) -> pa.Table:
        """Join all chunks into `results.parquet` and return them."""
        table = pa.concat_tables(pq.read_table(self._place(chunk)) for chunk in self.chunks)
        write_table(self.folder / "results.parquet", {n: table[n].to_numpy() for n in table.column_names})
        return table

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
    if folder.exists() and any(folder.iterdir()):
        raise input_error(folder, "is not empty and holds no run", "name a new or empty folder with -o")
    manifest = identity | {
        "seed": study.seed,
        "study": resolved(study),
        "chunks": chunks,
        "versions": versions(),
    }
    write_text(path, json.dumps(manifest, indent=2) + "\n")
    return RunStore(folder, manifest)


def _read_manifest(path: Path) -> dict[str, Any]:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise input_error(path, f"cannot be read as a manifest ({error})", "name a new folder with -o") from None


def write_text(path: Path, text: str) -> None:
    """Write a text file so that a crash leaves either the old file or the new one, never half of one.

    Raises:
        InputError: the file cannot be written there.
    """
    beside = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            beside.write_text(text, encoding="utf-8")
            os.replace(beside, path)
        finally:
            beside.unlink(missing_ok=True)
    except OSError as error:
        raise input_error(path, f"cannot be written ({error.strerror})", "check the folder and the disk") from None


def versions() -> dict[str, str]:
    """Return the versions of all that results depend on."""
    packages = ("vsajax", "jax", "jaxlib", "equinox", "optimistix", "numpy", "scipy")
    return {"python": platform.python_version()} | {name: metadata.version(name) for name in packages}
