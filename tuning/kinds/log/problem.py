"""Tuning an estimator on a robot's own log, and judging it on the part of the log that the search never saw."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from tuning.files.errors import InputError, Mistake, input_error
from tuning.files.whole import write_table, write_text
from tuning.kinds.log.study import LogStudy, tuned_config
from tuning.logs.reading import RecordingTable, read_recording
from tuning.problem.build import build_estimator, number
from tuning.runs.folder import versions
from tuning.search.descent import descent, ending
from tuning.search.space import Space, Vector
from tuning.study.base import resolved, study_hash, to_toml
from tuning.study.paths import numeric_paths
from tuning.terminal.progress import progress
from vsajax import Recording, experiment, rollout

_WITHIN = 0.999
_FEWEST = 20


class Given(NamedTuple):
    """What the objective is given: what dotted paths lead into, the log, and 1 at the samples that count."""

    estimator: Any
    recording: Recording
    chosen: Float[Array, " time"]


@dataclass(frozen=True)
class Agreement:
    """How well a torque signal agrees with the deflection over a part of a log.

    Args:
        correlation: with the deflection lagging as the torque does.
        unlagged: with the deflection itself.
        stiffness: slope of the line [N·m/rad].
        rms: of the torque signal [N·m].
        samples: of that part.
    """

    correlation: float
    unlagged: float
    stiffness: float
    rms: float
    samples: int


@dataclass(frozen=True)
class TunedLog:
    """What a search found.

    Args:
        values: the best numbers by path.
        objective: there, on the training part [%].
        before: of the study's own numbers [%].
        train: agreement there.
        held_out: agreement on the rest of the log.
        whole: agreement on all of it.
        floor: 99.9 % of the training part's torque lie within ± this [N·m].
        share_within: of the rest that does.
        rows: every point tried: its numbers, its objective [%], and how it came about.
        messages: how the starts ended.
    """

    values: dict[str, float]
    objective: float
    before: float
    train: Agreement
    held_out: Agreement
    whole: Agreement
    floor: float
    share_within: float
    rows: dict[str, np.ndarray]
    messages: list[str]


@dataclass(frozen=True)
class LogSearch:
    """A search over the `[tune]` parameters of a study of a log.

    Args:
        study: the study; its own numbers are the first start.
        table: the log.
    """

    study: LogStudy
    table: RecordingTable

    @cached_property
    def space(self) -> Space:
        """The space of the tuned numbers."""
        return Space.of(self.study.tune.parameters)

    @cached_property
    def recording(self) -> Recording:
        """The log."""
        columns = self.table.columns
        return Recording(**{name: jnp.asarray(columns[name]) for name in Recording._fields if name in columns})

    @cached_property
    def is_training(self) -> Bool[Array, " time"]:
        """Which samples are tuned on."""
        return self.recording.time <= self.study.recording.train_until

    @cached_property
    def given(self) -> Given:
        """What the objective is given."""
        return Given(build_estimator(self.study), self.recording, self.is_training.astype(float))

    def signals(self, values: Mapping[str, Any], given: Given) -> tuple[Any, Any]:
        """Return torque and lagging deflection at some numbers."""
        return experiment.agreement(_with(given, values).estimator, given.recording)

    def residuals(self, z: Vector, given: Given) -> Float[Array, " time"]:
        """Return the vector whose squared norm is the objective [√%].

        Agreement: what a line over the lagging deflection leaves of the torque, 1 − ρ². No load: the torque, over
        that of the motor at the joint.
        """
        torque, deflection = self.signals(self.space.constrain(z), given)
        share = given.chosen / jnp.sum(given.chosen)
        # Apart from the sums below: the root of a quotient of 0 has no derivative.
        weight = 10.0 * jnp.sqrt(share)
        if self.study.tune.objective == "no_load":
            drive = given.estimator.torque.gear_ratio * given.recording.motor_torque
            return weight * torque / jnp.sqrt(jnp.sum(share * drive**2))
        torque, deflection = (x - jnp.sum(share * x) for x in (torque, deflection))
        slope = jnp.sum(share * torque * deflection) / jnp.sum(share * deflection**2)
        # A line that falls explains nothing: a spring's torque grows with its deflection.
        left = torque - jnp.maximum(slope, 0.0) * deflection
        return weight * left / jnp.sqrt(jnp.sum(share * torque**2))

    def objective(self, z: Vector, given: Given) -> Float[Array, ""]:
        """Return the objective [%]."""
        left = self.residuals(z, given)
        return left @ left

    def screened(self) -> np.ndarray:
        """Return the unbounded vectors that are tried first: the study's own, and Sobol points."""
        own = {path: jnp.asarray(numeric_paths(self.study)[path]) for path in self.space.paths}
        shares = np.clip(self.space.sobol_shares(self.study.tune.screen, self.study.seed), 1e-3, 1.0 - 1e-3)
        return np.concatenate([np.asarray(self.space.unconstrain(own))[None], np.log(shares / (1.0 - shares))])

    def run(self, *, quiet: bool = False) -> TunedLog:
        """Screen, refine from the best, and judge."""
        points = self.screened()
        scores = jax.jit(lambda z, given: rollout.map_lanes(self.objective, z, given, chunk=16))
        values = np.asarray(scores(jnp.asarray(points), self.given))
        order = np.argsort(np.where(np.isfinite(values), values, np.inf))
        starts = list(dict.fromkeys([0, *map(int, order)]))[: self.study.tune.starts]
        descend = descent(self.objective, self.residuals, max_steps=self.study.tune.max_steps, rtol=1e-4)
        found, messages = [], []
        with progress("tune (log)", len(starts), quiet=quiet) as advance:
            for start in starts:
                end = descend(jnp.asarray(points[start]), self.given)
                messages.append(ending(end.result))
                found.append((np.asarray(end.z), float(end.value)))
                advance()
        tried = np.concatenate([points, [z for z, _ in found]])
        objective = np.concatenate([values, [value for _, value in found]])
        if not np.isfinite(objective).any():
            raise input_error(
                self.study.recording.file, "no numbers give a finite torque signal", "mend the bounds or the log"
            )
        best = int(np.nanargmin(objective))
        numbers = {path: float(x) for path, x in self.space.constrain(jnp.asarray(tried[best])).items()}
        every = jax.vmap(self.space.constrain)(jnp.asarray(tried))
        rows = {path: np.asarray(every[path]) for path in self.space.paths}
        rows |= {"objective": objective, "stage": np.array(["screen"] * len(points) + ["refine"] * len(found))}
        return self._judged(numbers, float(objective[best]), float(values[0]), rows, messages)

    def _judged(
        self,
        values: dict[str, float],
        objective: float,
        before: float,
        rows: dict[str, np.ndarray],
        messages: list[str],
    ) -> TunedLog:
        leaves = {path: jnp.asarray(value) for path, value in values.items()}
        torque, lagging = (np.asarray(x) for x in jax.jit(self.signals)(leaves, self.given))
        estimator = _with(self.given, leaves).estimator
        deflection = np.asarray(jax.jit(experiment.estimate)(estimator, self.recording).signals.deflection)
        train = np.asarray(self.is_training)
        parts = (train, ~train, np.ones_like(train))
        trained, held_out, whole = (_agreement(torque, lagging, deflection, at) for at in parts)
        floor = float(np.quantile(np.abs(torque[train]), _WITHIN))
        within = float(np.mean(np.abs(torque[~train]) <= floor))
        return TunedLog(values, objective, before, trained, held_out, whole, floor, within, rows, messages)


def _with(given: Given, values: Mapping[str, Any]) -> Given:
    """Return what is given, with the numbers at dotted paths replaced."""
    paths = list(values)
    return eqx.tree_at(lambda g: [number(g, path) for path in paths], given, [values[path] for path in paths])


def _agreement(torque: np.ndarray, lagging: np.ndarray, deflection: np.ndarray, at: np.ndarray) -> Agreement:
    def correlation(x: np.ndarray) -> float:
        x, y = x[at] - x[at].mean(), torque[at] - torque[at].mean()
        size = math.sqrt(float(x @ x) * float(y @ y))
        return float(x @ y) / size if size > 0.0 else math.nan

    moved = lagging[at] - lagging[at].mean()
    squares = float(moved @ moved)
    return Agreement(
        correlation(lagging),
        correlation(deflection),
        float(moved @ torque[at]) / squares if squares > 0.0 else math.nan,
        float(np.sqrt(np.mean(torque[at] ** 2))),
        int(np.count_nonzero(at)),
    )


def plan_log_search(study: LogStudy, place: str) -> LogSearch:
    """Read the log of a study.

    Raises:
        InputError: it cannot be read, lacks a signal, or leaves too few samples to tune on or to judge by.
    """
    recording = study.recording
    table = read_recording(
        Path(recording.file),
        None if recording.map is None else Path(recording.map),
        kind=study.kind,
        select=recording.select or None,
    )
    lacking = sorted(study.estimator.needs - table.columns.keys())
    if lacking:
        problem = "is missing, but the estimator needs this signal"
        raise InputError(*(Mistake(f"{table.source}: {name}", problem, "record or map it") for name in lacking))
    if study.tune.objective == "no_load" and "motor_torque" not in study.estimator.needs:
        raise input_error(
            f"{place}: tune.objective",
            "got 'no_load', which tunes a residual, but estimator.torque.type is another",
            'choose "agreement"',
        )
    time = table.columns["time"]
    before = int(np.count_nonzero(time <= recording.train_until))
    if min(before, len(time) - before) < _FEWEST:
        raise input_error(
            f"{place}: recording.train_until",
            f"got {recording.train_until} s, which leaves {before} samples to tune on and {len(time) - before} to "
            f"judge by; at least {_FEWEST} each are needed",
            f"choose a time within the log's {time[-1]:.4g} s",
        )
    return LogSearch(study, table)


def write_tuned_log(study: LogStudy, tuned: TunedLog, folder: Path) -> None:
    """Write `best.toml`, which `vsajax estimate -c` takes, and every point tried."""
    provenance = {
        "command": "tune",
        "method": "gradient",
        "objective": study.tune.objective,
        "recording": study.recording.model_dump(exclude_none=True),
        "study_hash": study_hash(study),
        "seed": study.seed,
        "versions": versions(study),
        "tuned": sorted(tuned.values),
        "train": asdict(tuned.train),
        "held_out": asdict(tuned.held_out),
        "noise_floor": tuned.floor,
        "held_out_within_floor": tuned.share_within,
    }
    tables = resolved(tuned_config(study, tuned.values, "tuned configuration"))
    tables["provenance"] = json.loads(json.dumps(provenance), parse_constant=str)
    write_table(folder / "results.parquet", tuned.rows)
    write_text(folder / "best.toml", to_toml(tables))
