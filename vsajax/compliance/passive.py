"""The passive stage: joint compliances whose hand compliance is nearest to what the task asks.

Petit, Albu-Schäffer, Section IV: min ‖J diag(c) Jᵀ − C_d‖ over c between bounds, in the norm weighted by G.
Letters: c joint compliances, C_p = J diag(c) Jᵀ passive and C_d desired compliance of the hand.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from vsajax import numerics
from vsajax.solvers.box import AbstractBoxSolver, BoxLeastSquares, BoxSolution, differentiable
from vsajax.types import Scalar


class StiffnessBounds(NamedTuple):
    """What the joints' mechanisms can be set to, 0 < lower ≤ upper [N·m/rad]."""

    lower: Float[Array, " n"]
    upper: Float[Array, " n"]


class PassiveFit(NamedTuple):
    """Joint compliances, and how they were found.

    Args:
        compliance: c [rad/(N·m)].
        working: of the compliances: −1 at the lower bound (the joint is as stiff as it can be), +1 at the upper, 0
            free.
        optimality: see `BoxSolution`.
    """

    compliance: Float[Array, " n"]
    working: Float[Array, " n"]
    optimality: Scalar


def hand_compliance(jacobian: Float[Array, "m n"], compliance: Float[Array, " n"]) -> Float[Array, "m m"]:
    """Return C_p = J diag(c) Jᵀ, eq. (3).

    Positive definite only where J has full row rank; the paper's remark after (11) asks for c > 0 alone.
    """
    return numerics.symmetric_part((jacobian * compliance) @ jacobian.T)


def compliance_problem(
    jacobian: Float[Array, "m n"],
    desired: Float[Array, "m m"],
    bounds: StiffnessBounds,
    weights: Float[Array, "m m"] | None = None,
) -> BoxLeastSquares:
    """Return (9) as the least squares (11), one row an entry of the lower triangle.

    Entries off the diagonal count twice, as in the Frobenius norm (10) of a symmetric matrix. The paper does not
    say which weights it took; all ones give its Table I, unique entries alone do not.

    Args:
        jacobian: J.
        desired: C_d.
        bounds: of the joints' stiffness.
        weights: G of (10), symmetric, not negative; all ones by default.
    """
    i, j = np.tril_indices(desired.shape[0])
    counts = jnp.asarray(np.where(i == j, 1.0, 2.0))
    scale = jnp.sqrt(counts if weights is None else counts * weights[i, j])
    return BoxLeastSquares(
        scale[:, None] * jacobian[i] * jacobian[j], scale * desired[i, j], 1.0 / bounds.upper, 1.0 / bounds.lower
    )


def fit_passive(
    jacobian: Float[Array, "m n"],
    desired: Float[Array, "m m"],
    bounds: StiffnessBounds,
    solver: AbstractBoxSolver,
    weights: Float[Array, "m m"] | None = None,
) -> PassiveFit:
    """Return the optimum of (9), differentiable in all its arguments but the solver."""
    problem = compliance_problem(jacobian, desired, bounds, weights)
    solution: BoxSolution = jax.lax.stop_gradient(solver.solve(jax.lax.stop_gradient(problem)))
    return PassiveFit(differentiable(problem, solution), solution.working, solution.optimality)
