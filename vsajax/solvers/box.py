"""Least squares between bounds: the problem, its solution, and how far from optimal an answer is."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from vsajax import numerics
from vsajax.types import Scalar


class BoxLeastSquares(NamedTuple):
    """min ‖A x − b‖² with lower ≤ x ≤ upper, bounds closed.

    The paper prints strict bounds in (9); the optimum lies on them.

    Args:
        design: A.
        target: b.
        lower: below `upper`.
        upper: above 0.
    """

    design: Float[Array, "rows n"]
    target: Float[Array, " rows"]
    lower: Float[Array, " n"]
    upper: Float[Array, " n"]


class BoxSolution(NamedTuple):
    """An answer to a `BoxLeastSquares`.

    Args:
        value: x.
        working: −1 where x is held at its lower bound, +1 at its upper, 0 where it is free.
        optimality: the largest entry of x − clip(x − ∇f) in the scaled problem, 0 at the optimum; see `Scaled`.
        solves: least-squares problems solved; 0 where the solver does a fixed amount of work.
    """

    value: Float[Array, " n"]
    working: Float[Array, " n"]
    optimality: Scalar
    solves: Int[Array, ""]


class Scaled(NamedTuple):
    """The problem in x / upper, divided so that AᵀA has the trace n; lanes may come last.

    Compliances are near 10⁻⁵ m/N: without a scale no tolerance means anything.

    Args:
        design: A.
        target: b.
        hessian: AᵀA.
        lower: lower / upper; the upper bound is 1.
    """

    design: Float[Array, "rows n ..."]
    target: Float[Array, "rows ..."]
    hessian: Float[Array, "n n ..."]
    lower: Float[Array, "n ..."]

    @classmethod
    def of(
        cls,
        design: Float[Array, "rows n ..."],
        target: Float[Array, "rows ..."],
        lower: Float[Array, "n ..."],
        upper: Float[Array, "n ..."],
    ) -> Scaled:
        """Return the scaled problem."""
        design = design * upper[None]
        size = numerics.safe_sqrt((design * design).sum((0, 1)) / design.shape[1])
        # An arm whose hand no joint moves has A = 0: every x is optimal, and any scale will do.
        divide = 1.0 / jnp.where(size > 0.0, size, 1.0)
        # One value each: jax 0.12 cannot transpose a barrier over values of which only some are differentiated.
        design, target = numerics.once(design * divide), numerics.once(target * divide)
        hessian = (design[:, :, None] * design[:, None]).sum(0)
        return cls(design, target, numerics.once(hessian), numerics.once(lower / upper))

    def gradient(self, x: Float[Array, "n ..."]) -> Float[Array, "n ..."]:
        """Return Aᵀ(A x − b), the residual first: H x − Aᵀb would lose the digits that they share."""
        residual = numerics.once(numerics.apply(self.design, x) - self.target)
        return numerics.apply_transposed(self.design, residual)

    def optimality(self, x: Float[Array, "n ..."]) -> Float[Array, "..."]:
        """Return max |x − clip(x − ∇f)|, 0 at the optimum."""
        return jnp.abs(x - jnp.clip(x - self.gradient(x), self.lower, 1.0)).max(0)


class AbstractBoxSolver(eqx.Module):
    """A way to solve bounded least squares in a fixed number of operations."""

    @abstractmethod
    def solve(self, problem: BoxLeastSquares) -> BoxSolution:
        """Return the solution; not differentiable by itself, see `differentiable`."""


def masked_inverse(problem: Scaled, working: Float[Array, "n ..."], ridge: float) -> Float[Array, "n n ..."]:
    """Return (H + ridge·I)⁻¹ of the free rows and columns, the others zero but for their diagonal."""
    free = jnp.where(working == 0.0, 1.0, 0.0)
    diagonal = numerics.identity_like(problem.hessian) * (1.0 - free + ridge)[None]
    return numerics.inverse(numerics.once(problem.hessian * (free[:, None] * free[None]) + diagonal))


def held(problem: Scaled, x: Float[Array, "n ..."], working: Float[Array, "n ..."]) -> Float[Array, "n ..."]:
    """Return x with what is held put on its bound."""
    return jnp.where(working < 0.0, problem.lower, jnp.where(working > 0.0, 1.0, x))


def solve_on(
    problem: Scaled, x: Float[Array, "n ..."], working: Float[Array, "n ..."], *, refinements: int
) -> Float[Array, "n ..."]:
    """Return the least-squares solution with `working` held, from a start x.

    A ridge makes a singular problem solvable; every refinement, a Newton step with that ridge, takes off the error
    it leaves by a factor ridge / λ in the direction of eigenvalue λ, and moves x nowhere along a null direction.
    """
    free = jnp.where(working == 0.0, 1.0, 0.0)
    x = held(problem, x, working)
    # Frozen, its steps leave the value where it is and give it the right derivative, and the program stays small.
    inverse = jax.lax.stop_gradient(masked_inverse(problem, working, RIDGE))
    for _ in range(refinements):
        x = numerics.once(x - free * numerics.apply(inverse, free * problem.gradient(x)))
    return x


def differentiable(problem: BoxLeastSquares, solution: BoxSolution) -> Float[Array, " n"]:
    """Return the solution's x as a function of the problem.

    Its derivative is that of the least-squares solution with the working set held: exact unless a multiplier is
    zero, where the solution has a kink. Where x is not unique its derivative is the one of least norm. Values cost
    nothing more; second derivatives are not right.
    """
    return _attached(problem, solution.value, solution.working)


@jax.custom_jvp
def _attached(
    problem: BoxLeastSquares, value: Float[Array, " n"], working: Float[Array, " n"]
) -> Float[Array, " n"]:
    return value


@_attached.defjvp
def _attached_jvp(primals: Any, tangents: Any) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    problem, value, working = primals

    def again(problem: BoxLeastSquares) -> Float[Array, " n"]:
        x = value / jax.lax.stop_gradient(problem.upper)
        return solve_on(Scaled.of(*problem), x, working, refinements=2) * problem.upper

    return value, jax.jvp(again, (problem,), (tangents[0],))[1]


RIDGE = 1e-11
"""Of the scaled problem, whose H has the trace n: far below the eigenvalues that matter (10⁻⁷), far above
rounding."""
OUTSIDE = 1e-13
"""By how much x must pass a bound to count as outside: what rounding does is not a violation."""
WRONG_SIGN = 1e-14
"""By how much a multiplier must be negative to count."""
