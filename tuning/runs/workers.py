"""What a worker does: it receives what to compute as JSON, and imports the code.

A process that computes its first chunk compiles; for those that follow it keeps the program.
"""

from __future__ import annotations

import functools
import importlib
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from tuning.runs import machine

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
    from tuning.runs.folder import run_id
    from tuning.study.base import FOLDER
    from tuning.study.inputs import absolute_inputs

    files = manifest.get("files", {})
    spec = {key: manifest[key] for key in ("command", "plan")}
    # A worker may run in another folder.
    folder = Path(manifest["study"].get("provenance", {}).get(FOLDER, ""))
    spec |= {
        name: absolute_inputs(held, files, folder)
        for name, held in (("study", manifest["study"]), ("files", files))
    }
    own = {"run": run_id(manifest)}
    return json.dumps(spec | own | {"xla_flags": os.environ.get("XLA_FLAGS", "")})


@functools.lru_cache(maxsize=2)
def planner_of(spec: str) -> Planner:
    """Return what `spec` says is computed; this process keeps it, and with it what it compiles.

    Raises:
        InputError: a file that the study names holds something else here than where the run was begun.
    """
    from tuning.study.inputs import check_inputs
    from tuning.study.loading import parse_study

    given = json.loads(spec)
    study = parse_study(given["study"], "manifest.json: study")
    check_inputs(given["files"], study, "the run folder")
    module, _, name = _PLANNERS[given["command"]].partition(":")
    planner = getattr(importlib.import_module(module), name)
    return planner.from_plan(study, given["plan"])


def run_chunk(spec: str, chunk: str) -> Columns:
    """Return the columns of a chunk, in a process that may never have imported jax."""
    os.environ["XLA_FLAGS"] = json.loads(spec)["xla_flags"]
    machine.start_jax()
    return planner_of(spec).run_chunk(chunk)


def run_share(spec: str, chunks: Sequence[str], folder: str) -> None:
    """Compute chunks into sealed files of a folder; one that is there is not computed again."""
    from tuning.runs.folder import write_sealed

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
