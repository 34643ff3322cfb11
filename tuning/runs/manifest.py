"""What a run folder says of itself: what is computed, from what, and by which versions."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

from tuning.files.errors import input_error
from tuning.files.seal import (
    SEALED,
    breaks_seal,
    hash_tables,
)
from tuning.runs.sealed import is_file
from tuning.study.base import Base, hash_resolved
from tuning.study.foreign import foreign_in

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

_KEYS = _LEGACY | {"files": dict, "edition": int, SEALED: str}

_JSON = {str: "string", dict: "object", list: "list", int: "whole number"}


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


def run_id(manifest: Mapping[str, Any]) -> str:
    """Return a hash of all that determines a run's results: command, study, plan, and the files that they name."""
    identity = {key: manifest[key] for key in ("command", "study_hash", "plan")}
    if edition_of(manifest) > 1:
        identity |= {"edition": edition_of(manifest)}
    return hash_tables(identity | {"files": manifest.get("files", {})})[:32]


def edition_of(manifest: Mapping[str, Any]) -> int:
    """Return the edition of the answers in a run, see `study.kinds.Kind`."""
    return manifest.get("edition", 1)


def versions(config: Base | None = None) -> dict[str, str]:
    """Return the versions of all that results depend on: those of a configuration, on its plug-ins too."""
    packages = ("vsajax", "jax", "jaxlib", "equinox", "optimistix", "numpy", "scipy")
    own = {"python": platform.python_version()} | {name: metadata.version(name) for name in packages}
    foreign = {} if config is None else foreign_in(config)
    return own | {record["name"]: record["version"] for record in foreign.values()}
