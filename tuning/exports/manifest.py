"""The manifest: what an export is, for whom it is valid, and how good it is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tuning.exports.artefact import Artefact, Subject
from tuning.exports.layout import Leaf, dotted
from tuning.exports.program import Slot
from tuning.runs.manifest import versions
from vsajax import jumps

SHIPPED = ["golden.csv", "README.md"]
"""What lies beside every artefact, with its check."""


_JUMPS = {"factor": jumps.FACTOR, "least": jumps.LEAST, "patience": jumps.PATIENCE}
"""How far a reading may jump, see `vsajax.jumps`."""


def manifest_of(subject: Subject, target: str, source: Path, artefact: Artefact) -> dict[str, Any]:
    """Return the manifest of an export, before it is checked."""
    deployable, program, golden = subject.deployable, subject.program, subject.golden
    config = deployable.config
    return {
        "format": target,
        "name": program.name,
        "what": deployable.noun,
        "files": list(artefact.files),
        "shipped": [*SHIPPED, *artefact.scripts],
        "source": source.name,
        "kind": config.kind,
        "study_hash": subject.identity,
        "versions": versions(config),
        "sample_time_s": deployable.sample_time,
        "needs_regular_clock": deployable.needs_regular_clock,
        "units": "SI: rad, s, N·m, N·m/rad",
        "inputs": _signals(program.inputs),
        "outputs": _signals(program.outputs),
        "leaves_out": list(program.guarded),
        "leaves_out_jumps": _JUMPS if program.watched else None,
        "parameters": parameters_of(subject),
        "valid": {
            "inputs": golden.ranges(),
            "note": f"checked on inputs in these ranges; beyond them it is what the {deployable.noun} is",
        },
        "golden": {"source": golden.source, "samples": len(golden.time), "seconds": float(golden.time[-1])},
        "scores": {k: v for k, v in config.provenance.items() if isinstance(v, dict)},
        "provenance": {k: v for k, v in config.provenance.items() if not isinstance(v, dict)},
        **artefact.figures,
        "rounding": golden.rounding,
    }


def parameters_of(subject: Subject) -> list[dict[str, Any]]:
    """Return every tunable number with its default, unit and range."""
    program = subject.program
    rows = []
    places = zip(program.parameters.places, program.defaults, program.limits.ranges, strict=True)
    for (path, leaf), value, limits in places:
        rows.append(
            {
                "name": dotted(path),
                "default": value.tolist(),
                "unit": leaf.unit,
                "meaning": leaf.meaning,
                "low": limits.low,
                "high": limits.high,
                "is_low_open": limits.is_low_open,
                "is_high_open": limits.is_high_open,
            }
        )
    return rows


def _signals(slot: Slot) -> list[dict[str, Any]]:
    return [_signal(dotted(path), leaf) for path, leaf in slot.places]


def _signal(name: str, leaf: Leaf) -> dict[str, Any]:
    return {"name": name, "type": leaf.kind, "shape": list(leaf.shape), "unit": leaf.unit, "meaning": leaf.meaning}
