"""Gradient tuning: forward-mode derivatives of the population's residual vector, into optimistix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Float

from tuning.control_problem import AnyProblem
from tuning.problem import Scenario
from tuning.space import Space, Vector

Algorithm = Literal["levenberg-marquardt", "bfgs"]


@dataclass(frozen=True)
class Outcome:
    """Where one start ended.

    Args:
        start: the numbers it started from.
        values: the numbers it ended at.
        objective: statistic of the training objective there [%].
        steps: of the optimiser.
        message: "converged", "step limit", or what the optimiser says.
    """

    start: dict[str, float]
    values: dict[str, float]
    objective: float
    steps: int
    message: str


@dataclass(frozen=True)
class GradientTuner:
    """Minimises a statistic of the study's objective over some scenarios.

    Args:
        problem: what is tuned.
        space: over which numbers.
        scenarios: `(scenario,)`, to train on.
        algorithm: Levenberg–Marquardt on the vector of relative errors, or BFGS on its square.
        max_steps: of the optimiser, per start.
    """

    problem: AnyProblem
    space: Space
    scenarios: Scenario
    algorithm: Algorithm = "levenberg-marquardt"
    max_steps: int = 60

    def residuals(self, z: Vector, given: Any) -> Float[Array, " residual"]:
        """Return the vector whose squared norm is the objective's statistic over the scenarios [√%]."""
        values = self.space.constrain(z)
        each = jax.vmap(lambda scenario: self.problem.residuals(values, scenario, given))(self.scenarios)
        # The statistic is a weighted sum of the scenarios' scores whose weights follow from their order alone.
        scores = jax.lax.stop_gradient(jnp.sum(each**2, axis=1))
        ranks = jnp.argsort(jnp.argsort(scores))
        weights = jnp.asarray(self.problem.study.tune.statistic.ranked_weights(scores.size))[ranks]
        return (jnp.sqrt(weights)[:, None] * each).reshape(-1)

    def objective(self, z: Vector, given: Any) -> Float[Array, ""]:
        """Return the objective's statistic over the scenarios [%]."""
        residuals = self.residuals(z, given)
        return residuals @ residuals

    @cached_property
    def _solve(self) -> Callable[[Vector, Any], tuple[Vector, Float[Array, ""], Any, Any]]:
        @jax.jit
        def solve(z: Vector, given: Any) -> tuple[Vector, Float[Array, ""], Any, Any]:
            if self.algorithm == "bfgs":
                solution = optx.minimise(
                    self.objective,
                    optx.BFGS(rtol=1e-3, atol=1e-9),
                    z,
                    args=given,
                    options={"autodiff_mode": "fwd"},
                    max_steps=self.max_steps,
                    throw=False,
                )
            else:
                solution = optx.least_squares(
                    self.residuals,
                    optx.LevenbergMarquardt(rtol=1e-3, atol=1e-9),
                    z,
                    args=given,
                    options={"jac": "fwd"},
                    max_steps=self.max_steps,
                    throw=False,
                )
            best = self.objective(solution.value, given)
            return solution.value, best, solution.stats["num_steps"], solution.result

        return solve

    def run(self, start: dict[str, float]) -> Outcome:
        """Minimise from one start. Starts are run one after another: batched ones wait for the slowest."""
        z = self.space.unconstrain({path: jnp.asarray(value) for path, value in start.items()})
        z, objective, steps, result = self._solve(z, self.problem.given)
        values = {path: float(value) for path, value in self.space.constrain(z).items()}
        return Outcome(start, values, float(objective), int(steps), _ending(result))


def _ending(result: optx.RESULTS) -> str:
    if bool(result == optx.RESULTS.successful):
        return "converged"
    if bool(result == optx.RESULTS.nonlinear_max_steps_reached):
        return "step limit"
    return optx.RESULTS[result].splitlines()[0]
