"""The paper's active-set algorithm, with a rule that does not cycle, and as printed."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from vsajax import numerics, rollout
from vsajax.solvers.box import AbstractBoxSolver, BoxLeastSquares, BoxSolution, Scaled, solve_on
from vsajax.solvers.working_set import Rule, corrected

Values = Float[Array, "n ..."]


class ActiveSet(AbstractBoxSolver):
    """Section IV-B: solve with the working set held, correct the set, until nothing changes.

    Whenever it stops it is optimal. As printed ("drop_first") it may cycle, against what Section IV-C says; the
    solution then stays apart from the optimum and `optimality` says so. The printed bound of 2^r solves counts
    r = 2n constraints, of which distinct working sets are 3ⁿ.

    Args:
        rule: how the working set is corrected.
        limit: solves allowed; what needs fewer idles for the rest.
    """

    rule: Rule = eqx.field(static=True, default="add_first")
    limit: int = eqx.field(static=True, default=24)

    def solve(self, problem: BoxLeastSquares) -> BoxSolution:
        """Return the solution, from the empty working set."""
        solve = numerics.lanes_last(self._solve)
        x, working, optimality, solves = solve(*problem)
        return BoxSolution(x * problem.upper, working, optimality, solves)

    def _solve(self, *problem: Array) -> tuple[Values, Values, Float[Array, "..."], Int[Array, "..."]]:
        scaled = Scaled.of(*problem)
        start = 0.5 * (scaled.lower + 1.0)
        none, count = jnp.zeros_like(start), jnp.zeros(start.shape[1:], int)

        def improve(state: tuple[Values, Values, Array, Array]) -> tuple[Values, Values, Array, Array]:
            _, working, solves, done = state
            x = solve_on(scaled, start, working, refinements=3)
            following = corrected(scaled, x, working, self.rule)
            solves = solves + jnp.where(done, 0, 1)
            return x, following, solves, done | (following == working).all(0)

        first = (start, none, count, jnp.zeros(start.shape[1:], bool))
        x, working, solves, _ = rollout.repeat(improve, first, times=self.limit)
        x = jnp.clip(x, scaled.lower, 1.0)
        return x, working, scaled.optimality(x), solves
