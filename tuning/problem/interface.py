"""A damping study made computable: what `problem.Problem` is for estimators, for controllers in the loop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from tuning.problem.build import build_loop, with_leaves
from tuning.problem.scenarios import Outcome, Problem, Scenario, Status, Values, Vector
from tuning.study.loading import DampingStudy, EstimationStudy, Study
from vsajax import ControlLoop, SwingMotion, SwingScores, closed_loop
from vsajax.closed_loop import Exchange


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
        """What `scores`, `outcome` and `objective` are given: one compilation serves every value."""
        return self.bench

    def motion(self, scenario: Scenario, given: ControlLoop) -> SwingMotion:
        """Return the motion in a scenario."""
        loop = with_leaves(given, scenario.numbers)
        return closed_loop.simulate(loop, key=scenario.key, substeps=self.substeps)

    def exchange(self, scenario: Scenario, given: ControlLoop) -> Exchange:
        """Return what the joint's controller was told in a scenario, and what it answered."""
        loop = with_leaves(given, scenario.numbers)
        return closed_loop.exchanges(loop, key=scenario.key, substeps=self.substeps)[0]

    def scores(self, values: Values, scenario: Scenario, given: ControlLoop) -> SwingScores:
        """Return the scores at `values` in a scenario."""
        loop = with_leaves(given, {**scenario.numbers, **values})
        return closed_loop.score(loop, key=scenario.key, substeps=self.substeps)

    def outcome(self, values: Values, scenario: Scenario, given: ControlLoop) -> Outcome:
        """Return the scores at `values` in a scenario, and whether they count."""
        scores = self.scores(values, scenario, given)
        return Outcome(scores, jnp.where(scores.diverged > 0, Status.MOTION_DIVERGED, Status.OK))

    def objective(
        self, values: Values, scenario: Scenario, given: ControlLoop, observed: object
    ) -> Float[Array, ""]:
        """Return the scenario's `log_energy`."""
        residuals = self._residuals(values, scenario, given)
        return residuals @ residuals

    def normal_equations(
        self,
        values_at: Callable[[Vector], Values],
        z: Vector,
        scenario: Scenario,
        given: ControlLoop,
        observed: object,
    ) -> Float[Array, "q q"]:
        """Return MᵀM of M = [J r], the residuals r and their derivatives J = ∂r/∂z at `values_at(z)`."""

        def residuals(z: Vector) -> Float[Array, " time"]:
            return self._residuals(values_at(z), scenario, given)

        whole = jnp.column_stack([jax.jacfwd(residuals)(z), residuals(z)])
        return whole.T @ whole

    def _residuals(self, values: Values, scenario: Scenario, given: ControlLoop) -> Float[Array, " time"]:
        loop = with_leaves(given, {**scenario.numbers, **values})
        return closed_loop.residuals(loop, key=scenario.key, substeps=self.substeps)


AnyProblem = Problem | ControlProblem


def problem_of(study: Study, varied: tuple[str, ...] = ()) -> AnyProblem:
    """Return the problem that a study poses."""
    if isinstance(study, DampingStudy):
        return ControlProblem(study, varied)
    assert isinstance(study, EstimationStudy)
    return Problem(study, varied)
