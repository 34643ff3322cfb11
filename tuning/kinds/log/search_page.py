"""The report on tuning on a log from before such runs had a manifest: a configuration, and every point tried."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tuning.files.errors import InputError, input_error
from tuning.pictures.page import Page, Picture, Table, number
from tuning.pictures.tried import draw_tried
from tuning.runs.sealed import read_table
from tuning.study.base import Base
from tuning.study.loading import load_config
from tuning.study.paths import numeric_paths

_PARTS = {"train": "tuned on", "held_out": "held out"}
_MEASURES = {
    "correlation": "correlation",
    "unlagged": "without the lag",
    "stiffness": "stiffness [N·m/rad]",
    "rms": "rms [N·m]",
    "samples": "samples",
}


def is_log_search(folder: Path) -> bool:
    """Return whether a folder holds what tuning on a log has found."""
    best = folder / "best.toml"
    if (folder / "manifest.json").exists() or not best.is_file():
        return False
    try:
        return "recording" in tomllib.loads(best.read_text(encoding="utf-8")).get("provenance", {})
    except (OSError, ValueError):
        return False


def report_log_search(folder: Path) -> Page:
    """Return the report on tuning on a log.

    Raises:
        InputError: a file is missing or cannot be read, or `best.toml` was changed.
    """
    best, results = folder / "best.toml", folder / "results.parquet"
    config, found = load_config(best), read_table(results)
    rows = {name: found[name].to_numpy() for name in found.column_names}
    try:
        return _page(folder, config, rows)
    except (KeyError, TypeError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise input_error(best, f"is not as tuning on a log has left it ({error!r})", "tune again") from None


def _page(folder: Path, config: Base, rows: Mapping[str, np.ndarray]) -> Page:
    provenance = config.provenance
    log, paths = provenance["recording"], list(provenance["tuned"])
    values, objective = numeric_paths(config), rows["objective"]
    least = float(np.nanmin(objective))
    parts = {label: provenance[name] for name, label in _PARTS.items()}
    measures = ["rms"] if provenance["objective"] == "no_load" else ["correlation", "unlagged", "stiffness"]
    said = "; ".join(f"{label}: {_MEASURES[measures[0]]} {_number(p[measures[0]])}" for label, p in parts.items())
    return Page(
        title=f"tune: {Path(log['file']).name}",
        headline=f"{provenance['objective']} of {number(least)} %, the best of {objective.size} points; {said}.",
        pictures=[
            Picture(
                "Points tried",
                draw_tried(
                    objective,
                    rows["stage"] == "refine",
                    {path.removeprefix("estimator."): rows[path] for path in paths},
                    "objective, training part [%]",
                ),
                "The objective over each number; the star is the best.",
                f"The objective over {', '.join(paths)} at {objective.size} points; least {number(least)} %.",
            )
        ],
        findings=[
            f"± {_number(provenance['noise_floor'])} N·m holds "
            f"{number(100.0 * float(provenance['held_out_within_floor']))} % of the held-out part's torque (and, "
            "being chosen so, 99.9 % of the part that was tuned on)"
        ]
        if provenance["objective"] == "no_load"
        else [],
        tables=[
            Table("What was tuned", ["number", "value"], [[path, values[path]] for path in paths]),
            Table(
                "Agreement of torque and deflection",
                ["", *(_MEASURES[name] for name in (*measures, "samples"))],
                [
                    [label, *(_number(part[name]) for name in (*measures, "samples"))]
                    for label, part in parts.items()
                ],
            ),
        ],
        provenance=Table(
            "",
            [],
            [
                ["folder", str(folder)],
                ["command", "vsajax tune"],
                ["log", log["file"]],
                ["signal map", log.get("map", "–")],
                ["tuned on", f"samples up to {log['train_until']:g} s"],
                ["study hash", provenance["study_hash"]],
                ["seed", provenance["seed"]],
                ["versions", ", ".join(f"{name} {version}" for name, version in provenance["versions"].items())],
            ],
        ),
        sources=[("The tuned configuration, best.toml", (folder / "best.toml").read_text(encoding="utf-8"))],
    )


def _number(value: Any) -> str:
    return str(value) if isinstance(value, int) else number(float(value))
