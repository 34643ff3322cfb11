"""What a worker does: it receives what to compute as JSON, and imports the code.

A process that computes its first chunk compiles; for those that follow it keeps the program.
"""

from __future__ import annotations

import functools
import json
import os
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from tuning.files.errors import InputError
from tuning.runs import machine
from tuning.study.foreign import PLUGINS
from tuning.study.plugins import consented, consenting, differing
from tuning.study.refs import Ref

Columns = dict[str, np.ndarray]

_PLANNERS = {"sweep": "tuning.scoring.sweep:GridSweep", "montecarlo": "tuning.scoring.montecarlo:MonteCarlo"}
"""By command, the class whose `from_plan(study, plan)` knows what each chunk is."""


class Planner(Protocol):
    """What a command computes, cut into chunks."""

    @property
    def chunks(self) -> list[str]: ...  # noqa: D102

    def run_chunk(self, chunk: str) -> Columns: ...  # noqa: D102


def spec_of(manifest: Mapping[str, Any]) -> str:
    """Return what another process needs to compute chunks of a run.

    The flags of XLA go along: among them the number of devices, by which lanes are grouped. A worker with other
    flags would round differently in the last digit.
    """
    from tuning.runs.manifest import run_id
    from tuning.study.base import FOLDER
    from tuning.study.inputs import absolute_inputs

    files = manifest.get("files", {})
    spec = {key: manifest[key] for key in ("command", "plan")}
    # A worker may run in another folder.
    folder = Path(manifest["study"].get("provenance", {}).get(FOLDER, ""))
    named = {"study": manifest["study"], "files": files}
    spec |= {name: absolute_inputs(held, files, folder) for name, held in named.items()}
    own: dict[str, Any] = {"run": run_id(manifest)}
    if PLUGINS in manifest["study"]:
        own["consented"] = consented()
    return json.dumps(spec | own | {"xla_flags": os.environ.get("XLA_FLAGS", "")})


@functools.lru_cache(maxsize=2)
def planner_of(spec: str) -> Planner:
    """Return what `spec` says is computed; this process keeps it, and with it what it compiles.

    Raises:
        InputError: a file that the study names holds something else here than where the run was begun, or a
            plug-in that it uses is missing here, or of another version.
    """
    from tuning.study.inputs import check_inputs
    from tuning.study.loading import parse_study

    given = json.loads(spec)
    require_plugins(spec)
    with consenting(*given.get("consented", ())):
        study = parse_study(given["study"], "manifest.json: study")
        check_inputs(given["files"], study, "the run folder")
        planner = Ref(_PLANNERS[given["command"]]).load()
        return planner.from_plan(study, given["plan"])


def uses_plugins(spec: str) -> bool:
    """Return whether what `spec` says needs anything that is not vsajax' own."""
    return PLUGINS in json.loads(spec)["study"]


def require_plugins(spec: str) -> None:
    """Refuse to compute in this process what needs plug-ins that it does not have.

    Raises:
        InputError: names every one that is missing or of another version, and this machine.
    """
    given = json.loads(spec)
    with consenting(*given.get("consented", ())):
        mistakes = differing(given["study"].get(PLUGINS, {}), f"worker on {platform.node()}")
    if mistakes:
        raise InputError(*mistakes)


def run_chunk(spec: str, chunk: str) -> Columns:
    """Return the columns of a chunk, in a process that may never have imported jax."""
    given = json.loads(spec)
    os.environ["XLA_FLAGS"] = given["xla_flags"]
    machine.start_jax()
    with consenting(*given.get("consented", ())):
        return planner_of(spec).run_chunk(chunk)


def run_share(spec: str, chunks: Sequence[str], folder: str) -> None:
    """Compute chunks into sealed files of a folder; one that is there is not computed again."""
    from tuning.runs.sealed import write_sealed

    for chunk in chunks:
        path = result_file(Path(folder), chunk)
        if not path.exists():
            write_sealed(path, run_chunk(spec, chunk), run_of(spec), chunk)


def run_of(spec: str) -> str:
    """Return what the chunks of a run are sealed with."""
    return json.loads(spec)["run"]


def result_file(folder: Path, chunk: str) -> Path:
    """Return where `run_share` leaves a chunk."""
    return folder / f"{chunk}.parquet"
