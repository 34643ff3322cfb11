"""The manifest: what an export is, for whom it is valid, and how good it is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tuning.exports.artefact import Artefact, Subject
from tuning.exports.layout import Leaf, dotted
from tuning.exports.program import Slot
from tuning.exports.ranges import range_of
from tuning.parts.estimators import AlgebraicObserver
from tuning.store import versions
from tuning.study import Study

SHIPPED = ["golden.csv", "README.md", "check.py", "checking.py"]
"""What lies beside every artefact."""


def manifest_of(subject: Subject, target: str, source: Path, artefact: Artefact) -> dict[str, Any]:
    """Return the manifest of an export, before it is checked."""
    config, program, golden = subject.config, subject.program, subject.golden
    return {
        "format": target,
        "name": program.name,
        "files": list(artefact.files),
        "shipped": SHIPPED,
        "source": source.name,
        "kind": config.kind,
        "study_hash": subject.identity,
        "versions": versions(),
        "sample_time_s": sample_time(subject),
        "needs_regular_clock": needs_regular_clock(subject),
        "units": "SI: rad, s, N·m, N·m/rad",
        "inputs": _signals(program.inputs),
        "outputs": _signals(program.outputs),
        "parameters": parameters_of(subject),
        "valid": {
            "inputs": golden.ranges(),
            "note": "the artefact was checked on inputs in these ranges; beyond them it is what the estimator is",
        },
        "golden": {"source": golden.source, "samples": len(golden.time), "seconds": float(golden.time[-1])},
        "scores": {k: v for k, v in config.provenance.items() if isinstance(v, dict)},
        "provenance": {k: v for k, v in config.provenance.items() if not isinstance(v, dict)},
        **artefact.figures,
        "rounding": golden.rounding,
    }


def sample_time(subject: Subject) -> float | None:
    """Return the sample time that the estimator was made for [s]; `None` where any will do."""
    observers = _observers(subject)
    if observers:
        return observers[0].sample_time
    return subject.config.clock.sample_time if isinstance(subject.config, Study) else None


def needs_regular_clock(subject: Subject) -> bool:
    """Return whether the estimator takes no other sample time."""
    return bool(_observers(subject))


def _observers(subject: Subject) -> list[AlgebraicObserver]:
    estimator = subject.config.estimator
    parts = [estimator, getattr(estimator, "side", None), getattr(estimator, "other", None)]
    return [part for part in parts if isinstance(part, AlgebraicObserver)]


def parameters_of(subject: Subject) -> list[dict[str, Any]]:
    """Return every tunable number with its default, unit and range."""
    program = subject.program
    rows = []
    for (path, leaf), value in zip(program.parameters.places, program.defaults, strict=True):
        limits = range_of(subject.config, path)
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
