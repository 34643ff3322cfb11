"""A damping study made computable: what `problem.Problem` is for estimators, for controllers in the loop."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import jax.numpy as jnp
from jaxtyping import Array, Float

from tuning.build import build_loop, with_leaves
from tuning.problem import Outcome, Problem, Scenario, Status, Values
from tuning.study import DampingStudy, EstimationStudy, Study
from vsajax import ControlLoop, SwingMotion, SwingScores, closed_loop


@dataclass(frozen=True)
class ControlProblem:
    """A study's closed loop, and its scores as pure functions of varied numbers and scenarios.

    Args:
        study: the study.
        varied: dotted paths of the numbers that will vary, beside the population's.
    """

    study: DampingStudy
    varied: tuple[str, ...] = ()

    @cached_property
    def bench(self) -> ControlLoop:
        """The loop at the study's own numbers."""
        return build_loop(self.study)

    @property
    def samples(self) -> int:
        """Number of samples of a run."""
        return self.bench.clock.samples

    @property
    def substeps(self) -> int:
        """Integration steps a sample."""
        return self.study.substeps

    @property
    def given(self) -> ControlLoop:
        """What `scores`, `outcome` and `residuals` are given: one compilation serves every value."""
        return self.bench

    def motion(self, scenario: Scenario, given: ControlLoop) -> SwingMotion:
        """Return the motion in a scenario."""
        loop = with_leaves(given, scenario.numbers)
        return closed_loop.simulate(loop, key=scenario.key, substeps=self.substeps)

    def scores(self, values: Values, scenario: Scenario, given: ControlLoop) -> SwingScores:
        """Return the scores at `values` in a scenario."""
        loop = with_leaves(given, {**scenario.numbers, **values})
        return closed_loop.score(loop, key=scenario.key, substeps=self.substeps)

    def outcome(self, values: Values, scenario: Scenario, given: ControlLoop) -> Outcome:
        """Return the scores at `values` in a scenario, and whether they count."""
        scores = self.scores(values, scenario, given)
        return Outcome(scores, jnp.where(scores.diverged > 0, Status.MOTION_DIVERGED, Status.OK))

    def residuals(self, values: Values, scenario: Scenario, given: ControlLoop) -> Float[Array, " time"]:
        """Return the vector whose squared norm is the scenario's `log_energy`."""
        loop = with_leaves(given, {**scenario.numbers, **values})
        return closed_loop.residuals(loop, key=scenario.key, substeps=self.substeps)


AnyProblem = Problem | ControlProblem


def problem_of(study: Study, varied: tuple[str, ...] = ()) -> AnyProblem:
    """Return the problem that a study poses."""
    if isinstance(study, DampingStudy):
        return ControlProblem(study, varied)
    assert isinstance(study, EstimationStudy)
    return Problem(study, varied)
