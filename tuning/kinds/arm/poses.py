"""Better poses for many targets, each from several starts."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from matplotlib.figure import Figure

from tuning.kinds.arm.bench import ArmBench
from tuning.kinds.arm.run import write_run
from tuning.kinds.arm.study import ArmStudy
from tuning.pictures.style import ESTIMATE, OTHER, QUIET, new_figure, save
from tuning.terminal.progress import Advance
from vsajax import rollout
from vsajax.control import PoseSearch, fit_passive, hand_compliance, improve_pose, inverse, reach, stiffness_errors

_IN_PLACE = 1e-7


def passive_error(bench: ArmBench, positions: Float[Array, " joints"]) -> Array:
    """Return the relative error of the best passive compliance at a pose: what a search makes small.

    Under a load it is the error that the load leaves of the fit without it.
    """
    compliance = _fitted(bench, bench.jacobian(positions))
    return stiffness_errors(bench.passive(positions, compliance), inverse(bench.desired)).compliance


def _fitted(bench: ArmBench, jacobian: Float[Array, "m joints"]) -> Float[Array, " joints"]:
    return fit_passive(jacobian, inverse(bench.desired), bench.bounds, bench.designer.solver).compliance


@eqx.filter_jit
def passive_errors(bench: ArmBench, jacobians: Float[Array, "lanes m joints"]) -> Float[Array, " lanes"]:
    """Return the error of the best passive compliance for many Jacobians, however they came about; no load."""
    arrays, rest = eqx.partition(bench, eqx.is_array)

    def one(jacobian: Float[Array, "m joints"], shared: Any) -> Array:
        own = eqx.combine(shared, rest)
        found = hand_compliance(jacobian, _fitted(own, jacobian))
        return stiffness_errors(found, inverse(own.desired)).compliance

    return rollout.map_lanes(one, jacobians, arrays)


@eqx.filter_jit
def search(
    bench: ArmBench, starts: Float[Array, "lanes joints"], hands: Float[Array, "lanes 3"], steps: int
) -> tuple[Array, PoseSearch]:
    """Return for each lane how far from its place the hand starts [m], and the search."""
    arrays, rest = eqx.partition(bench, eqx.is_array)

    def one(lane: tuple[Array, Array], shared: Any) -> tuple[Array, PoseSearch]:
        own, (start, hand) = eqx.combine(shared, rest), lane
        placed, shift = reach(own.arm, start, hand, own.ranges)
        found = improve_pose(lambda q: passive_error(own, q), own.arm, placed, hand, own.ranges, steps=steps)
        return shift, found

    return rollout.map_lanes(one, (starts, hands), arrays)


def improve_poses(
    study: ArmStudy, bench: ArmBench, advance: Advance
) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Return a row a target: the error at its own pose, from it and from the best start, and a summary.

    Targets are the hand's positions at poses that are drawn. The first start of each is that pose;
    the others are random and brought to the target; one that does not get there within 1e-7 m counts as no start.
    """
    rng = np.random.default_rng(study.seed)
    began = time.perf_counter()
    targets, starts = study.poses.targets, study.poses.starts
    own = bench.draw_starts(rng, targets)
    hands = np.asarray(eqx.filter_vmap(lambda q: bench.arm.forward(q).position)(jnp.asarray(own)))
    before, after, random, poses, shifts = [], [], [], [], []
    for k in range(starts):
        first = own if k == 0 else bench.draw_starts(rng, targets)
        shift, found = search(bench, jnp.asarray(first), jnp.asarray(hands), study.poses.steps)
        counts = (np.asarray(shift) < _IN_PLACE) & np.isfinite(np.asarray(found.value))
        before.append(np.where(counts, found.initial, np.inf))
        after.append(np.where(counts, found.value, np.inf))
        random.append(counts)
        poses.append(np.asarray(found.positions))
        shifts.append(np.where(counts, found.shift, 0.0))
        advance()
    best = np.argmin(np.stack(after), axis=0)
    chosen = np.stack(poses)[best, np.arange(targets)]
    columns = {f"hand_{axis}": hands[:, i] for i, axis in enumerate("xyz")}
    columns |= {
        "own_error": before[0],
        "own_search_error": after[0],
        "best_start_error": np.min(before, axis=0),
        "best_search_error": np.min(after, axis=0),
        "starts_in_place": np.sum(random, axis=0),
    }
    columns |= {f"{name}_position": chosen[:, i] for i, name in enumerate(bench.names)}
    names = {
        "own pose": "own_error",
        "searched from the own pose": "own_search_error",
        f"best of {starts} poses, not searched": "best_start_error",
        f"searched from {starts} poses": "best_search_error",
    }
    reached = np.isfinite(columns["best_search_error"])
    summary = {
        "ok": bool(reached.any()),
        "joints": list(bench.names),
        "targets": targets,
        "unreached": int((~reached).sum()),
        "starts": starts,
        "in_place": int(np.sum(random)),
        "median_error": {label: _median(columns[name]) for label, name in names.items()},
        "largest_shift": float(np.max(shifts)),
        "seconds": time.perf_counter() - began,
    }
    return columns, summary


def _median(values: np.ndarray) -> float | None:
    kept = values[np.isfinite(values)]
    return float(np.median(kept)) if kept.size else None


def write_poses(
    study: ArmStudy, columns: dict[str, np.ndarray], folder: Path, summary: Mapping[str, Any]
) -> list[Path]:
    """Write the run and the picture into a folder."""
    files = write_run(folder, "poses", study, summary, columns)
    return [*files, save(draw_poses(columns), folder / "poses.png")]


def draw_poses(columns: dict[str, np.ndarray]) -> Figure:
    """Draw how the errors of the targets are distributed, before and after."""
    figure, axis = new_figure(6.4, 3.6)
    for name, label, colour in (
        ("own_error", "own pose", QUIET),
        ("own_search_error", "searched from it", ESTIMATE),
        ("best_search_error", "searched from several", OTHER),
    ):
        values = np.sort(100.0 * columns[name][np.isfinite(columns[name])])
        axis.plot(values, (np.arange(values.size) + 0.5) / columns[name].size, color=colour, label=label)
    axis.set(xlabel="passive compliance error [%]", ylabel="share of targets", ylim=(0.0, 1.0))
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3)
    return figure
