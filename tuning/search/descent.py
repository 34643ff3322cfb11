"""Downhill from one start: optimistix on a residual vector or on its square, compiled once for every start."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import jax
import optimistix as optx
from jaxtyping import Array, Float, Int

from tuning.search.space import Vector

Algorithm = Literal["levenberg-marquardt", "bfgs"]


class Descended(NamedTuple):
    """Where a descent ended.

    Args:
        z: the point.
        value: of the objective there.
        steps: of the optimiser.
        result: how it ended, for `ending`.
    """

    z: Vector
    value: Float[Array, ""]
    steps: Int[Array, ""]
    result: optx.RESULTS


def descent(
    objective: Callable[[Vector, Any], Float[Array, ""]],
    residuals: Callable[[Vector, Any], Float[Array, " q"]],
    *,
    max_steps: int,
    algorithm: Algorithm = "levenberg-marquardt",
    rtol: float = 1e-3,
) -> Callable[[Vector, Any], Descended]:
    """Return a compiled descent (z, given) -> where it ended; derivatives are taken forward.

    Args:
        objective: (z, given) -> what is minimised.
        residuals: (z, given) -> residuals whose squared norm is the objective.
        max_steps: of the optimiser.
        algorithm: Levenberg–Marquardt on the residuals, or BFGS on the objective.
        rtol: relative change at which it has converged.
    """
    least_squares = algorithm == "levenberg-marquardt"
    options = {"jac": "fwd"} if least_squares else {"autodiff_mode": "fwd"}

    @jax.jit
    def descend(z: Vector, given: Any) -> Descended:
        settings: dict[str, Any] = {"args": given, "options": options, "max_steps": max_steps, "throw": False}
        if least_squares:
            solver = optx.LevenbergMarquardt(rtol=rtol, atol=1e-9)
            solution = optx.least_squares(residuals, solver, z, **settings)
        else:
            solution = optx.minimise(objective, optx.BFGS(rtol=rtol, atol=1e-9), z, **settings)
        value = objective(solution.value, given)
        return Descended(solution.value, value, solution.stats["num_steps"], solution.result)

    return descend


def ending(result: optx.RESULTS) -> str:
    """Return "converged", "step limit", or what the optimiser says."""
    if bool(result == optx.RESULTS.successful):
        return "converged"
    if bool(result == optx.RESULTS.nonlinear_max_steps_reached):
        return "step limit"
    return optx.RESULTS[result].splitlines()[0]
