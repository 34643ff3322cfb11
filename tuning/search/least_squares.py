"""Gradient tuning: least squares over all residuals of all scenarios, accumulated as they run, into optimistix.

optimistix is given a handful of residuals that stand for all: r = R[:, q] and J = R[:, :q] of a square root
RᵀR = [J r]ᵀ[J r]. Levenberg–Marquardt sees nothing else of the residuals, so its steps are the same, and memory
grows neither with the recordings' length nor with their number.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from tuning.problem.interface import Differentiable, Scenario
from tuning.search.descent import Algorithm, Descended, descent, ending
from tuning.search.space import Space, Vector
from tuning.study.ranges import Reach
from vsajax import rollout
from vsajax.rollout import sensitivity

LANES_PER_CHUNK = 128
"""A chunk of several is copied out of all recordings; a single one, on every core, is not."""
Lane = tuple[Scenario, Any]


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

    problem: Differentiable
    space: Space
    scenarios: Scenario
    algorithm: Algorithm = "levenberg-marquardt"
    max_steps: int = 60

    @cached_property
    def observed(self) -> Any:
        """What is observed in every scenario, stacked; `None` where the tuned numbers change it."""
        problem = self.problem
        if any(Reach.RECORDING in problem.study.reach(path) for path in self.space.paths):
            return None
        observe = jax.jit(
            lambda lanes, given: rollout.map_lanes(lambda s, g: problem.observe({}, s, g), lanes, given)
        )
        return observe(self.scenarios, problem.given)

    @property
    def given(self) -> Any:
        """What `objective` and `residuals` are given, as arguments of one compiled program."""
        return (self.scenarios, self.observed), self.problem.given

    def _loop(self, z: Vector, lane: Lane, common: Any) -> sensitivity.Loop:
        scenario, observed = lane
        return self.problem.residuals(self.space.constrain(z), scenario, common, observed)

    def normal_equations(self, z: Vector, given: Any) -> Float[Array, "q q"]:
        """Return MᵀM of M = [J r], r all scenarios' residuals whose squares sum to the objective [√%]."""

        def of_one(lane: Lane, shared: tuple[Vector, Any]) -> Float[Array, "q q"]:
            z, common = shared
            return sensitivity.normal_equations(lambda z: self._loop(z, lane, common), z)

        lanes, common = given
        each = rollout.map_lanes(of_one, lanes, (z, common), chunk=LANES_PER_CHUNK)
        return jnp.tensordot(self._weights(each[:, -1, -1]), each, axes=1)

    def objective(self, z: Vector, given: Any) -> Float[Array, ""]:
        """Return the objective's statistic over the scenarios [%]. It has first derivatives."""

        @jax.custom_jvp
        def value(z: Vector, given: Any) -> Float[Array, ""]:
            def of_one(lane: Lane, shared: tuple[Vector, Any]) -> Float[Array, ""]:
                z, common = shared
                return sensitivity.sum_of_squares(self._loop(z, lane, common))

            lanes, common = given
            scores = rollout.map_lanes(of_one, lanes, (z, common), chunk=LANES_PER_CHUNK)
            return self._weights(scores) @ scores

        @value.defjvp
        def _(primals: Any, tangents: Any) -> tuple[Float[Array, ""], Float[Array, ""]]:
            square = self.normal_equations(*primals)
            return square[-1, -1], 2.0 * square[-1, :-1] @ tangents[0]

        return value(z, given)

    def residuals(self, z: Vector, given: Any) -> Float[Array, " q"]:
        """Return few residuals with the squared norm, the gradient and the Gauss–Newton matrix of all.

        They are those of a square root of `normal_equations`. They have first derivatives.
        """

        @jax.custom_jvp
        def few(z: Vector, given: Any) -> Float[Array, " q"]:
            return _root(self.normal_equations(z, given))[:, -1]

        @few.defjvp
        def _(primals: Any, tangents: Any) -> tuple[Float[Array, " q"], Float[Array, " q"]]:
            root = _root(self.normal_equations(*primals))
            return root[:, -1], root[:, :-1] @ tangents[0]

        return few(z, given)

    def _weights(self, scores: Float[Array, " scenario"]) -> Float[Array, " scenario"]:
        """Return the statistic's weights, which follow from the scores' order alone."""
        ranks = jnp.argsort(jnp.argsort(scores))
        return jnp.asarray(self.problem.study.tune.statistic.ranked_weights(scores.size))[ranks]

    @cached_property
    def _descend(self) -> Callable[[Vector, Any], Descended]:
        return descent(self.objective, self.residuals, max_steps=self.max_steps, algorithm=self.algorithm)

    def run(self, start: dict[str, float]) -> Outcome:
        """Minimise from one start. Starts are run one after another: batched ones wait for the slowest."""
        z = self.space.unconstrain({path: jnp.asarray(value) for path, value in start.items()})
        end = self._descend(z, self.given)
        values = {path: float(value) for path, value in self.space.constrain(end.z).items()}
        return Outcome(start, values, float(end.value), int(end.steps), ending(end.result))


def _root(square: Float[Array, "q q"]) -> Float[Array, "q q"]:
    """Return R with RᵀR = `square`, which is positive semidefinite up to rounding."""
    size = jnp.sqrt(jnp.diagonal(square))
    scale = jnp.where(size > 0.0, size, 1.0)
    values, vectors = jnp.linalg.eigh(square / (scale[:, None] * scale))
    return jnp.sqrt(jnp.maximum(values, 0.0))[:, None] * vectors.T * scale
