"""Scenarios of a study run again, for what they look like over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from tuning.problem.build import with_leaves
from tuning.problem.scenarios import Given, Problem, Scenario, Stream, draw_scenarios
from tuning.study.loading import EstimationStudy
from vsajax import experiment, rollout

_POINTS = 400
"""Samples kept of a trace: a picture shows no more."""
_LANES = 8
"""Scenarios at a time on a device: whole recordings are held."""


@dataclass(frozen=True)
class Replay:
    """Thinned traces, `(scenario, time)`.

    Args:
        time: [s].
        truth: true stiffness [N·m/rad].
        estimate: estimated stiffness [N·m/rad].
        known: whether the estimator says that it knows it.
    """

    time: np.ndarray
    truth: np.ndarray
    estimate: np.ndarray
    known: np.ndarray

    def part(self, rows: slice) -> Replay:
        """Return some of the scenarios."""
        return Replay(self.time[rows], self.truth[rows], self.estimate[rows], self.known[rows])


def replay(study: EstimationStudy, stream: Stream, numbers: Sequence[int]) -> Replay:
    """Run the scenarios of a stream with given numbers again."""
    problem = Problem(study)
    each = [draw_scenarios(study, stream, 1, number) for number in numbers]
    scenarios = jax.tree.map(lambda *x: jnp.concatenate(x), *each)
    kept = np.unique(np.linspace(0, problem.samples - 1, _POINTS).astype(int))

    def one(scenario: Scenario, given: Given) -> tuple[jax.Array, ...]:
        truth, recording = problem.record(scenario, given)
        answer = experiment.estimate(with_leaves(given.bench, scenario.numbers).estimator, recording)
        traces = (truth.time, truth.motion.stiffness, answer.stiffness, answer.known)
        return tuple(jnp.asarray(trace)[kept] for trace in traces)

    given = problem.given
    run = jax.jit(lambda lanes, shared: rollout.map_lanes(one, lanes, shared, chunk=_LANES))
    return Replay(*(np.asarray(trace) for trace in run(scenarios, given)))
