"""What torque-only axes cost: the covariance recursion of a lane runs once for all of them."""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import pytest

from tests.tuning.builders import GAIN, PRIOR, SERIAL
from tuning.kinds.estimation.problem import EstimationProblem
from tuning.problem.scenarios import draw_scenarios
from tuning.scoring.grid import Grid, lane_program
from tuning.study.loading import load_study

GAINS, PRIORS = [10.0 * 2.0**i for i in range(8)], [10.0**-i for i in range(8)]


@pytest.fixture(scope="module")
def problem() -> EstimationProblem:
    """The AwAS with all 18 coefficients: the covariance is most of the work, as in the paper."""
    return EstimationProblem(load_study(SERIAL, ["clock.duration=0.05", "sweep={}", "tune={}"]), (GAIN, PRIOR))


def multiplications(program) -> int:
    """Return how many scalar products a traced program takes, those of a loop as often as it runs."""
    total = 0
    for equation in program.eqns:
        if equation.primitive.name == "mul":
            total += math.prod(equation.outvars[0].aval.shape)
        inner = [getattr(p, "jaxpr", p) for p in equation.params.values()]
        times = equation.params.get("length", 1) if equation.primitive.name == "scan" else 1
        total += times * sum(multiplications(p) for p in inner if hasattr(p, "eqns"))
    return total


def work(program, *arguments) -> int:
    return multiplications(jax.make_jaxpr(program)(*arguments))


def work_of_grid(problem: EstimationProblem, axes, scenarios: int) -> int:
    grid = Grid(problem, axes, scenarios)
    return work(grid.program, *grid.arguments(grid.outer_points))


@pytest.mark.slow(twin="tests/vsajax/test_compiled.py::test_covariance_is_shared_by_what_only_touches_the_torque")
@pytest.mark.structure
def test_gains_and_noise_draws_share_the_covariance_and_priors_do_not(problem):
    single = work_of_grid(problem, {GAIN: GAINS[:1], PRIOR: PRIORS}, 1)
    # A gain or a draw takes an innovation, a correction and two scalar products, 4 d, and the torque filter;
    # the covariance that it shares takes more than 3 d². With d = 18 seven more add less than the whole again.
    assert work_of_grid(problem, {GAIN: GAINS, PRIOR: PRIORS}, 1) < 2.0 * single
    assert work_of_grid(problem, {GAIN: GAINS[:1], PRIOR: PRIORS}, 8) < 2.0 * single

    # The measure sees what is not shared: the same 64 points as lanes of their own.
    drawn = draw_scenarios(problem.study, "train", 1)
    points = jnp.array([[gain, prior] for gain in GAINS for prior in PRIORS])
    lanes = (points, (), jax.tree.map(lambda x: jnp.broadcast_to(x, (len(points), 1)), drawn))
    unshared = lane_program(problem, (GAIN, PRIOR), (), width=1)
    assert work(unshared, lanes, problem.given) > 7.0 * single
