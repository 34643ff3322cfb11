"""Running the checks of an exported folder; nothing of jax is needed here."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tuning.exports import checks
from tuning.files.errors import input_error
from tuning.study.plugins import ENVIRONMENT, consented

CHECKS = Path(checks.__file__).parent
"""The scripts that check an export; copies travel with it."""


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


def check_folder(folder: Path, *, trusted: bool = False) -> Exported:
    """Run the checks of an exported folder again, all of them.

    What is run are the scripts of this package on the folder's artefact, and no script of the folder, which may
    come from anybody. Its own must be the same, byte for byte: else another check would be told of than it has.

    Args:
        folder: what `export_config` wrote.
        trusted: run the folder's own check instead, whatever it does.

    Raises:
        InputError: it is no export, or its scripts are not those of this package.
    """
    manifest = read_manifest(folder)
    if trusted:
        return Exported([], _run(folder / "check.py", folder, folder, thorough=True))
    return Exported([], run_check(folder, _own_check(folder, manifest), thorough=True))


def _own_check(folder: Path, manifest: dict[str, Any]) -> str:
    """Return the module of `checks` that a folder's check.py is, all its scripts being those of this package."""
    scripts = sorted({"check.py", "checking.py", *(n for n in manifest["shipped"] if str(n).endswith(".py"))})
    own = {path.name: path.read_bytes() for path in CHECKS.glob("*.py")}
    found = {name: (folder / name).read_bytes() for name in scripts if (folder / name).is_file()}
    module = next((name for name, text in own.items() if text == found.get("check.py")), None)
    odd = [name for name in scripts if name != "check.py" and found.get(name) != own.get(name, b"")]
    if module is None or odd:
        raise input_error(
            folder / ("check.py" if module is None else odd[0]),
            "is not the script of this version of vsajax: running it would run whatever somebody wrote there",
            "read it, then add --trust; or export again with this version",
        )
    return module.removesuffix(".py")


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


def run_check(folder: Path, module: str, *, thorough: bool) -> list[dict[str, Any]]:
    """Run a module of `checks` on a folder in a fresh process and return what it found."""
    # Not in the folder: nothing of it is to be taken for a module.
    return _run(CHECKS / f"{module}.py", folder, CHECKS, thorough=thorough)


def _run(script: Path, folder: Path, within: Path, *, thorough: bool) -> list[dict[str, Any]]:
    with tempfile.TemporaryDirectory() as place:
        report = Path(place) / "results.json"
        command = [sys.executable, str(script.resolve()), "--folder", str(folder.resolve()), "--json", str(report)]
        command += [] if thorough else ["--quick"]
        # What may be imported here may be imported there: some checks read the configuration.
        given = os.environ | {ENVIRONMENT: ",".join(consented())}
        ran = subprocess.run(command, cwd=within, env=given, capture_output=True, text=True, check=False)
        if report.is_file():
            return json.loads(report.read_text(encoding="utf-8"))
    lines = (ran.stderr or ran.stdout).strip().splitlines()
    return [{"name": "check.py", "state": "failed", "what": lines[-1] if lines else "ended without a word"}]
