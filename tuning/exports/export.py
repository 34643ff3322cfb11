"""Writing a configuration as TOML or JSON, and reading it back to see that nothing was lost."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tuning.store import versions, write_text
from tuning.study import Study, load_config, resolved, study_hash, to_toml

_FORMATS: dict[str, tuple[Callable[[Mapping[str, Any]], str], Callable[[str], Any]]] = {
    "toml": (to_toml, tomllib.loads),
    "json": (lambda tables: json.dumps(tables, indent=2) + "\n", json.loads),
}


@dataclass(frozen=True)
class Exported:
    """What an export wrote, and what its check found.

    Args:
        files: written, the artefact first.
        ok: whether the check passed.
        check: what was checked, in words.
    """

    files: list[Path]
    ok: bool
    check: str


def export_config(path: Path, target: str, folder: Path) -> Exported:
    """Write the configuration at `path` to `folder` as "toml" or "json", with `manifest.json`.

    Raises:
        InputError: the configuration is not valid, or the folder cannot be written.
    """
    config = load_config(path)
    write, read = _FORMATS[target]
    tables = resolved(config)
    artefact, manifest = folder / f"estimator.{target}", folder / "manifest.json"
    write_text(artefact, write(tables))
    ok = read(artefact.read_text(encoding="utf-8")) == tables
    contents = {
        "format": target,
        "file": artefact.name,
        "source": path.name,
        "study_hash": study_hash(config),
        "sample_time_s": config.clock.sample_time if isinstance(config, Study) else None,
        "units": "SI: rad, s, N·m, N·m/rad",
        "versions": versions(),
        "scores": {k: v for k, v in config.provenance.items() if isinstance(v, dict)},
        "check": {"ok": ok, "what": "read back equal to what was written"},
    }
    write_text(manifest, json.dumps(contents, indent=2) + "\n")
    return Exported([artefact, manifest], ok, "read back equal" if ok else "what was read back DIFFERS")
