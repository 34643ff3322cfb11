"""The default solver: a primal-dual interior point of fixed length, then an exact polish of the active set."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from vsajax import numerics, rollout
from vsajax.solvers.box import AbstractBoxSolver, BoxLeastSquares, BoxSolution, Scaled, solve_on
from vsajax.solvers.working_set import corrected

Values = Float[Array, "n ..."]

_CENTRING = 0.1
"""Start of the multipliers above their sign constraint, in units of the largest gradient."""
_ROOM = 1e-6
_TO_THE_BOUNDARY = 0.995
_CONVERGED = 1e-22
"""Complementarity below which an iterate stays: further steps would divide rounding by rounding."""


class _Iterate(NamedTuple):
    """x, its distances to the bounds, and the multipliers of these."""

    x: Values
    above: Values
    below: Values
    lower: Values
    upper: Values

    def moved(self, step: _Step, length: Float[Array, "..."]) -> _Iterate:
        return _Iterate(
            self.x + length * step.x,
            self.above + length * step.x,
            self.below - length * step.x,
            self.lower + length * step.lower,
            self.upper + length * step.upper,
        )

    def complementarity(self) -> Float[Array, "..."]:
        return (self.above * self.lower + self.below * self.upper).sum(0) / (2 * self.x.shape[0])

    def reach(self, step: _Step) -> Float[Array, "..."]:
        """Return the reciprocal of the longest step that keeps every sign."""
        primal = jnp.maximum(-step.x / self.above, step.x / self.below)
        dual = jnp.maximum(-step.lower / self.lower, -step.upper / self.upper)
        return jnp.maximum(primal, dual).max(0)


class _Step(NamedTuple):
    x: Values
    lower: Values
    upper: Values


class InteriorPoint(AbstractBoxSolver):
    """Mehrotra's predictor-corrector, a fixed number of iterations, then passes over the active set.

    With strictly complementary solutions the iterate tells held from free by many orders of magnitude; the passes
    solve on that set exactly, and put right what little is left where a multiplier is almost zero. Singular
    problems, such as a hand's position from seven joints, are solved too: their objective is optimal, their x one
    of many.

    Args:
        iterations: of the interior point; 10 suffice for every problem tried, see docs/cartesian.md.
        passes: over the active set, each adds what is outside or, if nothing is, lets go the worst.
    """

    iterations: int = eqx.field(static=True, default=20)
    passes: int = eqx.field(static=True, default=3)

    def solve(self, problem: BoxLeastSquares) -> BoxSolution:
        """Return the solution; its cost does not depend on the numbers."""
        solve = numerics.lanes_last(self._solve)
        x, working, optimality = solve(*problem)
        return BoxSolution(x * problem.upper, working, optimality, jnp.zeros((), int))

    def _solve(self, *problem: Array) -> tuple[Values, Values, Float[Array, "..."]]:
        scaled = Scaled.of(*problem)
        linear = numerics.once(numerics.apply_transposed(scaled.design, scaled.target))
        # A joint whose bounds meet has no interior; the passes hold it where it is.
        roomy = scaled._replace(lower=jnp.minimum(scaled.lower, 1.0 - _ROOM))
        last = rollout.repeat(
            lambda i: _iteration(scaled, linear, i), _start(roomy, linear), times=self.iterations
        )
        working = jnp.where(last.lower > last.above, -1.0, jnp.where(last.upper > last.below, 1.0, 0.0))

        def improve(state: tuple[Values, Values]) -> tuple[Values, Values]:
            x = solve_on(scaled, *state, refinements=2)
            return x, corrected(scaled, x, state[1])

        x, working = rollout.repeat(improve, (last.x, working), times=self.passes)
        x = jnp.clip(solve_on(scaled, x, working, refinements=2), scaled.lower, 1.0)
        return x, working, scaled.optimality(x)


def _start(problem: Scaled, linear: Values) -> _Iterate:
    x = 0.5 * (problem.lower + 1.0)
    gradient = numerics.apply(problem.hessian, x) - linear
    margin = _CENTRING * jnp.abs(gradient).max(0) + 1e-4
    lower, upper = jnp.maximum(gradient, 0.0) + margin, jnp.maximum(-gradient, 0.0) + margin
    return _Iterate(x, x - problem.lower, 1.0 - x, lower, upper)


def _iteration(problem: Scaled, linear: Values, now: _Iterate) -> _Iterate:
    """One predictor and one corrector with the same inverse."""
    ratios = now.lower / now.above, now.upper / now.below
    dual = numerics.apply(problem.hessian, now.x) - linear - now.lower + now.upper
    dual, ratios = numerics.once((dual, ratios))
    diagonal = numerics.identity_like(problem.hessian) * (ratios[0] + ratios[1] + 1e-14)[None]
    inverse = numerics.inverse(problem.hessian + diagonal)

    def step(lower: Values, upper: Values) -> _Step:
        """Return the step to H dx − dλₗ + dλᵤ = −dual, dλₗ = lower − ratio dx and dλᵤ = upper + ratio dx."""
        change = numerics.once(numerics.apply(inverse, -dual + lower - upper))
        return _Step(change, lower - ratios[0] * change, upper + ratios[1] * change)

    predicted = step(-now.lower, -now.upper)
    length = 1.0 / jnp.maximum(now.reach(predicted), 1.0)
    gap = now.complementarity()
    share = now.moved(predicted, length).complementarity() / gap
    centre = share * share * share * gap
    lower = (centre - predicted.x * predicted.lower) / now.above - now.lower
    upper = (centre + predicted.x * predicted.upper) / now.below - now.upper
    chosen = step(*numerics.once((lower, upper)))
    length = 1.0 / jnp.maximum(now.reach(chosen) / _TO_THE_BOUNDARY, 1.0)
    return now.moved(chosen, numerics.once(jnp.where(gap > _CONVERGED, length, 0.0)))
