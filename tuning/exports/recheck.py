"""Running the checks of an exported folder; nothing of jax is needed here."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tuning.errors import input_error


@dataclass(frozen=True)
class Exported:
    """What an export wrote, and what its checks found.

    Args:
        written: files, the artefact first.
        results: of the checks: name, state, what, figures.
    """

    written: list[Path]
    results: list[dict[str, Any]]

    @property
    def ok(self) -> bool:
        """Whether no check failed and one at least passed."""
        states = [result["state"] for result in self.results]
        return "failed" not in states and "passed" in states


def check_folder(folder: Path) -> Exported:
    """Run the checks of an exported folder again, all of them.

    Raises:
        InputError: it is not one.
    """
    read_manifest(folder)
    return Exported([], run_check(folder, thorough=True))


def read_manifest(folder: Path) -> dict[str, Any]:
    """Return the manifest of an exported folder.

    Raises:
        InputError: it has none that can be read, or lacks a file that it names.
    """
    path = folder / "manifest.json"
    fix = "name a folder that `vsajax export` wrote"
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
        names = [*manifest["files"], *manifest["shipped"]]
    except FileNotFoundError:
        raise input_error(folder, "holds no export: it has no manifest.json", fix) from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise input_error(path, f"cannot be read as the manifest of an export ({error})", fix) from None
    lacking = [name for name in names if not (folder / name).is_file()]
    if lacking:
        raise input_error(folder, f"lacks {', '.join(lacking)}, which its manifest names", "export it again")
    return manifest


def run_check(folder: Path, *, thorough: bool) -> list[dict[str, Any]]:
    """Run a folder's own check in a fresh process and return what it found."""
    with tempfile.TemporaryDirectory() as place:
        report = Path(place) / "results.json"
        command = [sys.executable, "check.py", "--json", str(report), *([] if thorough else ["--quick"])]
        ran = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if report.is_file():
            return json.loads(report.read_text(encoding="utf-8"))
    lines = (ran.stderr or ran.stdout).strip().splitlines()
    return [{"name": "check.py", "state": "failed", "what": lines[-1] if lines else "ended without a word"}]
