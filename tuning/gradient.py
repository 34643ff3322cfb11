"""Gradient tuning: forward-mode derivatives of the population's residual vector, into optimistix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Float, Key

from tuning.problem import Problem
from tuning.space import Space, Vector

Algorithm = Literal["levenberg-marquardt", "bfgs"]


@dataclass(frozen=True)
class Outcome:
    """Where one start ended.

    Args:
        start: the numbers it started from.
        values: the numbers it ended at.
        objective: mean training objective there [%].
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
    """Minimises the mean of the study's objective over some scenarios.

    Args:
        problem: what is tuned.
        space: over which numbers.
        keys: the training scenarios.
        algorithm: Levenberg–Marquardt on the vector of relative errors, or BFGS on its square.
        max_steps: of the optimiser, per start.
    """

    problem: Problem
    space: Space
    keys: Key[Array, " scenario"]
    algorithm: Algorithm = "levenberg-marquardt"
    max_steps: int = 60

    def residuals(self, z: Vector, given: Any) -> Float[Array, " residual"]:
        """Return the vector whose squared norm is the mean objective over the scenarios [√%]."""
        values = self.space.constrain(z)
        each = jax.vmap(lambda key: self.problem.residuals(values, key, given))(self.keys)
        return each.reshape(-1) / jnp.sqrt(self.keys.shape[0])

    def objective(self, z: Vector, given: Any) -> Float[Array, ""]:
        """Return the mean objective over the scenarios [%]."""
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
