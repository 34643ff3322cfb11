"""The run folder of a command on an arm: what was asked, what came of it, from which a report is written."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tuning.files.errors import input_error
from tuning.files.seal import SEALED, breaks_seal, hash_tables, seal_tables
from tuning.files.toml import validate
from tuning.files.whole import write_text
from tuning.kinds.arm.study import ArmStudy
from tuning.runs.manifest import versions
from tuning.runs.sealed import columns_of, read_sealed, write_sealed
from tuning.study.base import resolved, study_hash

_MANIFEST = "manifest.json"
_KIND = "arm"
_TABLES = {"workspace": "workspace.parquet", "poses": "poses.parquet", "montecarlo": "accuracy.parquet"}
"""What each command leaves beside its manifest; `stiffness` has one pose, and no table.

`montecarlo` left one before its runs were those of all kinds; such a folder is still read.
"""


@dataclass(frozen=True)
class ArmRun:
    """A finished run of a command on an arm.

    Args:
        folder: its folder.
        command: that ran.
        study: what it ran on.
        result: what it printed for machines.
        columns: of its table by name; none of `stiffness`.
        manifest: all that the folder says of it.
    """

    folder: Path
    command: str
    study: ArmStudy
    result: Mapping[str, Any]
    columns: Mapping[str, np.ndarray]
    manifest: Mapping[str, Any]


def require_folder(folder: Path, command: str) -> None:
    """Refuse a folder that holds the run of another command, before anything is computed.

    Raises:
        InputError: it does, or is no folder.
    """
    if folder.exists() and not folder.is_dir():
        raise input_error(folder, "is a file, not a run folder", "name another folder with -o")
    held = _read(folder)
    if held is not None and (held.get("kind"), held.get("command")) != (_KIND, command):
        told = f"holds a run of vsajax {held.get('command', 'another program')}"
        raise input_error(folder, told, "name another folder with -o")


def write_run(
    folder: Path,
    command: str,
    study: ArmStudy,
    result: Mapping[str, Any],
    columns: Mapping[str, np.ndarray] | None = None,
) -> list[Path]:
    """Write a run and return its files; the manifest is the last, so that a run without it is not finished.

    Args:
        folder: made if need be.
        command: that ran.
        study: what it ran on.
        result: what it prints for machines; what JSON has no number for becomes null.
        columns: of its table, if it has one.
    """
    identity = {
        "kind": _KIND,
        "command": command,
        "study_hash": study_hash(study),
        "seed": study.seed,
        "study": resolved(study),
        "result": result,
        "versions": versions(study),
    }
    manifest = json.loads(json.dumps(identity, default=str), parse_constant=lambda _: None)
    files = []
    if columns is not None:
        files.append(folder / _TABLES[command])
        write_sealed(files[0], columns, hash_tables(manifest), command)
    files.append(folder / _MANIFEST)
    write_text(files[-1], json.dumps(seal_tables(manifest), indent=2) + "\n")
    return files


def read_run(folder: Path) -> ArmRun:
    """Return the run that a folder holds.

    Raises:
        InputError: a file of it is missing, damaged, or another run's.
    """
    path = folder / _MANIFEST
    again = "run the command again"
    manifest = _read(folder)
    if manifest is None or breaks_seal(manifest):
        raise input_error(path, "does not hold what was written: it breaks its seal", again)
    try:
        command, result = manifest["command"], manifest["result"]
        study = validate(ArmStudy, manifest["study"], f"{path}: study")
    except (KeyError, TypeError) as error:
        raise input_error(path, f"cannot be read as the manifest of an arm ({error!r})", again) from None
    columns: Mapping[str, np.ndarray] = {}
    if command in _TABLES:
        run = hash_tables({key: value for key, value in manifest.items() if key != SEALED})
        columns = columns_of(read_sealed(folder / _TABLES[command], run, command))
    return ArmRun(folder, command, study, result, columns, manifest)


def _read(folder: Path) -> dict[str, Any] | None:
    path = folder / _MANIFEST
    if not path.is_file():
        return None
    try:
        tables = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return tables if isinstance(tables, dict) else {}
