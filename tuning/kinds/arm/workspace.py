"""The stiffness that an arm can have, pose by pose over its workspace."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from tuning.kinds.arm.bench import ArmBench, PoseOutcome, outcomes, told_statuses, usable
from tuning.kinds.arm.run import write_run
from tuning.kinds.arm.study import ArmStudy
from tuning.pictures.style import ESTIMATE, OTHER, new_figure, save
from vsajax.control import Status

Columns = dict[str, np.ndarray]


def map_workspace(study: ArmStudy, bench: ArmBench) -> tuple[Columns, dict[str, Any]]:
    """Return the outcome of every pose drawn, as columns, and a summary: `ok` if any pose has a usable design."""
    positions = bench.draw(np.random.default_rng(study.seed), study.workspace.poses)
    start = time.perf_counter()
    found = outcomes(bench, jnp.asarray(positions))
    values = {name: np.asarray(value) for name, value in found._asdict().items()}
    elapsed = time.perf_counter() - start
    columns: Columns = {f"{name}_position": positions[:, i] for i, name in enumerate(bench.names)}
    columns |= {f"hand_{axis}": values["hand"][:, i] for i, axis in enumerate("xyz")}
    stiffness = values["joint_stiffness"]
    columns |= {f"{name}_stiffness": stiffness[:, i] for i, name in enumerate(bench.names)}
    columns |= {name: value for name, value in values.items() if value.ndim == 1}
    verdict = {"ok": bool(usable(found).any()), "meaning": told_statuses(columns["status"])}
    return columns, verdict | _summary(columns, bench.names, elapsed)


def _summary(columns: Columns, joints: Sequence[str], elapsed: float) -> dict[str, Any]:
    status = columns["status"]
    counted = {kind.name.lower(): int((status == kind).sum()) for kind in Status}
    errors = [name for name in PoseOutcome._fields if name.endswith("_error")]
    quantiles = {name: _quantiles(columns[name]) for name in errors}
    return {
        "joints": list(joints),
        "poses": int(status.size),
        "statuses": counted,
        "exact_share": float(columns["is_exact"].mean()),
        "quantiles": quantiles,
        "seconds": elapsed,
    }


_LEVELS = (0.1, 0.5, 0.9)


def _quantiles(values: np.ndarray) -> dict[str, float | None]:
    kept = _finite(values)
    return {f"{q:g}": float(np.quantile(kept, q)) if kept.size else None for q in _LEVELS}


def _finite(values: np.ndarray) -> np.ndarray:
    return values[np.isfinite(values)]


def write_workspace(study: ArmStudy, columns: Columns, folder: Path, summary: Mapping[str, Any]) -> list[Path]:
    """Write the run and the map into a folder."""
    files = write_run(folder, "workspace", study, summary, columns)
    return [*files, save(draw_workspace(study, columns), folder / "workspace.png")]


def draw_workspace(study: ArmStudy, columns: Columns) -> Figure:
    """Draw what the joints alone leave, and how often the design is exact, over the hand's places."""
    figure, axes = new_figure(12.0, 3.9, 1, 3, width_ratios=(1.0, 1.0, 0.8))
    error = 100.0 * columns["passive_compliance_error"]
    kept = _finite(error)
    top = max(float(np.quantile(kept, 0.95)), 1e-9) if kept.size else 1.0
    _draw_map(axes[0], study, columns, error, np.median, top)
    axes[0].set_title("joints alone: median compliance error [%]")
    exact = np.where(columns["status"] <= Status.NOT_OPTIMAL, 100.0 * columns["is_exact"], np.nan)
    _draw_map(axes[1], study, columns, exact, np.mean, 100.0)
    axes[1].set_title("with the controller: share met exactly [%]")
    _draw_distribution(axes[2], columns)
    return figure


def _draw_map(axis: Any, study: ArmStudy, columns: Columns, values: np.ndarray, reduce: Any, top: float) -> None:
    first, second = study.workspace.plane
    kept = np.isfinite(values)
    drawn = axis.hexbin(
        columns[f"hand_{first}"][kept],
        columns[f"hand_{second}"][kept],
        C=values[kept],
        gridsize=study.workspace.cells,
        reduce_C_function=reduce,
        cmap="viridis",
        vmin=0.0,
        vmax=top,
    )
    axis.set(xlabel=f"{first} [m]", ylabel=f"{second} [m]")
    axis.set_aspect("equal")
    axis.grid(False)
    axis.figure.colorbar(drawn, ax=axis, shrink=0.85)


def _draw_distribution(axis: Any, columns: Columns) -> None:
    for name, label, colour, style in (
        ("passive_compliance_error", "joints, compliance", ESTIMATE, "-"),
        ("passive_stiffness_error", "joints, stiffness", ESTIMATE, "--"),
        ("compliance_error", "with controller, compliance", OTHER, "-"),
        ("stiffness_error", "with controller, stiffness", OTHER, "--"),
    ):
        values = np.sort(_finite(100.0 * columns[name]))
        if values.size:
            shares = (np.arange(values.size) + 0.5) / values.size
            axis.plot(np.maximum(values, _SMALLEST), shares, style, color=colour, label=label)
    axis.set_xscale("log")
    axis.set(xlabel=f"relative error, at least {_SMALLEST:g} [%]", ylabel="share of poses", ylim=(0.0, 1.0))
    if axis.lines:
        axis.legend(loc="lower left", bbox_to_anchor=(-0.1, 1.0), ncols=2, fontsize=7)


_SMALLEST = 1e-3
