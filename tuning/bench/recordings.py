"""Recordings for the estimators to work on: every lane a joint of its own, with noise of its own."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from tuning.bench.joints import AWAS, MENARD, Kind, spread
from tuning.kinds.estimation.problem import EstimationProblem
from tuning.problem.build import with_leaves
from vsajax import Bench, Recording, rollout
from vsajax.experiments import estimation

_SIGNALS: dict[Kind, tuple[str, ...]] = {
    "serial": ("link_position", "motor_position", "setpoint_position", "motor_torque"),
    "antagonistic": ("link_position", "motor1_position", "motor2_position", "motor1_torque", "motor2_torque"),
}


class Lanes(NamedTuple):
    """What each lane's estimator reads, and what it should find.

    Args:
        signals: `(lane, time)` by their names in a `Recording`.
        stiffness: the true one, `(lane, time)` [N·m/rad].
    """

    signals: dict[str, jax.Array]
    stiffness: jax.Array

    def recording(self, time: jax.Array) -> Recording:
        """Return the recording of a single lane at `time` [s]."""
        return Recording(time, **self.signals)

    def columns(self) -> list[np.ndarray]:
        """Return the signals and the true stiffness as the opponent takes them."""
        return [np.ascontiguousarray(x) for x in (*self.signals.values(), self.stiffness)]


def record_joints(problem: EstimationProblem, kind: Kind, lanes: int) -> tuple[jax.Array, Lanes]:
    """Return the instants [s], and recordings of `lanes` joints within ±10 % of the study's."""
    # The study's own number, not `problem.substeps`, which would simulate to check it.
    substeps, paths, names = problem.study.substeps, AWAS if kind == "serial" else MENARD, _SIGNALS[kind]
    if substeps is None:
        raise ValueError("the bench's studies say how many integration steps a sample takes")

    def record(own: tuple[dict[str, jax.Array], jax.Array], shared: Bench) -> Lanes:
        values, key = own
        bench = with_leaves(shared, values)
        truth = estimation.simulate(bench, key=key, substeps=substeps)
        recording = estimation.measure(bench, truth, key=key)
        return Lanes({name: getattr(recording, name) for name in names}, truth.motion.stiffness)

    values = {path: jnp.asarray(column) for path, column in spread(problem.bench, paths, lanes).items()}
    keys = jax.random.split(jax.random.key(problem.study.seed), lanes)
    recorded = jax.jit(lambda own, bench: rollout.map_lanes(record, own, bench))((values, keys), problem.bench)
    # A dictionary comes out of a jitted program with its keys sorted.
    signals = {name: recorded.signals[name] for name in names}
    return problem.bench.clock.times(key=jax.random.key(0)), Lanes(signals, recorded.stiffness)


def intervals_of(time: jax.Array) -> np.ndarray:
    """Return the time since the last sample, 0 for the first [s]."""
    return np.asarray(jnp.diff(time, prepend=time[:1]))
