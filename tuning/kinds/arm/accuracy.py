"""What an error in the joints' stiffness costs at the hand.

A mechanism is set to the designed stiffness as far as somebody estimated it: the joint really has k (1 + e). The
controller was designed for k, so that the hand's compliance is C_a + J diag(c / (1 + e)) Jᵀ instead of C_s.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from matplotlib.figure import Figure

from tuning.files.errors import input_error
from tuning.kinds.arm.problem import ArmProblem
from tuning.kinds.arm.run import write_run
from tuning.kinds.arm.study import ArmStudy
from tuning.pictures.style import ESTIMATE, OTHER, TRUTH, new_figure, save
from tuning.runs.folder import read_results, read_table
from vsajax import rollout
from vsajax.compliance import stiffness_errors

_FROM_RUN = "run"
_LEAST = 0.05
"""No joint is left with less than this share of its stiffness, whatever the draw."""


@eqx.filter_jit
def _hand_errors(
    problem: ArmProblem, positions: Float[Array, "draws joints"], errors: Float[Array, "draws joints"]
) -> Float[Array, "draws 3"]:
    arrays, rest = eqx.partition(problem, eqx.is_array)

    def one(lane: tuple[Array, Array], shared: Any) -> Array:
        own, (q, error) = eqx.combine(shared, rest), lane
        design = own.design(q)
        actual = own.passive(q, design.joint_compliance / jnp.maximum(1.0 + error, _LEAST))
        found = stiffness_errors(design.active + actual, design.desired)
        # What the error itself does, apart from an offset that the design has without it.
        change = stiffness_errors(design.active + actual, design.serial)
        return jnp.stack([found.stiffness, found.compliance, change.stiffness])

    return rollout.map_lanes(one, (positions, errors), arrays)


def run_accuracy(
    study: ArmStudy, problem: ArmProblem, path: Path, draws: int | None = None
) -> dict[str, np.ndarray]:
    """Return one row a draw: level of MSREP [%], and the relative errors of the hand's stiffness.

    The relative error of a joint is drawn normal with the variance MSREP / 100, as MSREP is the mean square of
    relative errors in %; at the level of a run every joint draws a robot of its own. A robot whose
    estimate diverged leaves no stiffness to set: its draw has no numbers, and is counted as failed.

    Args:
        study: of the arm.
        problem: the same, computable.
        path: the study's file, where a relative path to a run starts.
        draws: at each level; by default the study's.
    """
    count = draws or study.accuracy.draws
    rng = np.random.default_rng(study.seed)
    positions, shapes = problem.draw(rng, count), rng.normal(size=(count, problem.arm.joints))
    levels: list[tuple[float, np.ndarray]] = [
        (level, np.full(shapes.shape, level)) for level in study.accuracy.msrep
    ]
    if study.accuracy.run is not None:
        known = _msrep_of_run(path.parent / study.accuracy.run, f"{path}: accuracy.run")
        levels.append((np.nan, rng.choice(known, shapes.shape)))
    columns: dict[str, list[np.ndarray]] = {"msrep": [], **{name: [] for name in _ERRORS}}
    for level, msrep in levels:
        found = np.asarray(
            _hand_errors(problem, jnp.asarray(positions), jnp.asarray(shapes * np.sqrt(msrep / 100.0)))
        )
        columns["msrep"].append(np.full(count, level))
        for i, name in enumerate(_ERRORS):
            columns[name].append(found[:, i])
    return {name: np.concatenate(parts) for name, parts in columns.items()}


_ERRORS = ("stiffness_error", "compliance_error", "stiffness_change")


def _msrep_of_run(folder: Path, place: str) -> np.ndarray:
    file = folder / "results.parquet"
    if not file.is_file():
        raise input_error(place, f"{folder} is no finished run", "name a folder that `vsajax montecarlo` wrote")
    try:
        table = read_results(folder) if (folder / "manifest.json").exists() else read_table(file)
        values = np.asarray(table["msrep_settled"], float)
    except (KeyError, TypeError) as error:
        problem = f"{file} has no column msrep_settled ({error})"
        raise input_error(place, problem, "name a run of an estimator") from None
    values = np.where(np.isfinite(values), values, np.nan)
    if np.isnan(values).all():
        raise input_error(place, f"{file} has no finite msrep_settled", "its robots all failed; mend that run")
    return values


def summarise(columns: dict[str, np.ndarray]) -> list[dict[str, Any]]:
    """Return median and 95 % quantile of the errors at each level, in order of the levels."""
    levels = list(dict.fromkeys("run" if np.isnan(v) else float(v) for v in columns["msrep"]))
    rows = []
    for level in levels:
        chosen = np.isnan(columns["msrep"]) if level == _FROM_RUN else columns["msrep"] == level
        row: dict[str, Any] = {"msrep": level}
        for name in _ERRORS:
            values = columns[name][chosen]
            row["failed"] = int((~np.isfinite(values)).sum())
            kept = values[np.isfinite(values)]
            for label, q in (("median", 0.5), ("q95", 0.95)):
                row[f"{name}_{label}"] = float(np.quantile(kept, q)) if kept.size else None
        rows.append(row)
    return rows


def write_accuracy(
    study: ArmStudy, columns: dict[str, np.ndarray], folder: Path, result: Mapping[str, Any]
) -> list[Path]:
    """Write the run with all draws, and the picture, into a folder."""
    files = write_run(folder, "montecarlo", study, result, columns)
    return [*files, save(draw_accuracy(columns), folder / "accuracy.png")]


def draw_accuracy(columns: dict[str, np.ndarray]) -> Figure:
    """Draw the errors of the hand against the MSREP of the joints."""
    medians = [f"{name}_median" for name in ("stiffness_error", "stiffness_change")]
    told = [row for row in summarise(columns) if all(row[name] is not None for name in medians)]
    rows = [row for row in told if row["msrep"] != _FROM_RUN and row["msrep"] > 0.0]
    figure, axis = new_figure(6.4, 3.8)
    levels = [row["msrep"] for row in rows]
    for name, label, colour in (
        ("stiffness_error", "against the desired stiffness", OTHER),
        ("stiffness_change", "against the designed stiffness", ESTIMATE),
    ):
        median, upper = ([100.0 * row[f"{name}_{which}"] for row in rows] for which in ("median", "q95"))
        axis.plot(levels, median, "o-", color=colour, label=f"{label}, median")
        axis.plot(levels, upper, "o--", color=colour, label="95 % of draws")
    for row in told:
        if row["msrep"] == _FROM_RUN:
            axis.axhline(100.0 * row["stiffness_change_median"], color=TRUTH, linewidth=0.9, linestyle=":")
            place = {"transform": axis.get_yaxis_transform(), "va": "bottom", "fontsize": 8}
            axis.text(0.02, 100.0 * row["stiffness_change_median"], "run, median", **place)
    if told:
        # Of nothing, and of errors that are all zero, there is no logarithm.
        axis.set(xscale="log", yscale="log")
    axis.set_xlabel("MSREP of the joints' stiffness [%]")
    axis.set_ylabel("relative error of the hand's stiffness [%]")
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, fontsize=8)
    return figure
