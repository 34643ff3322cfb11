"""Passive fit, scaling and active fit against an independent NumPy and SciPy reproduction."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import lsq_linear

from vsajax import rollout
from vsajax.compliance import Status, StiffnessBounds, StiffnessDesigner, compliance_problem
from vsajax.solvers import ActiveSet, Enumeration, InteriorPoint, inverse
from vsajax.solvers.spectrum import eigen, floored, largest_generalised_eigenvalue

GOLDEN = Path(__file__).parents[2] / "golden" / "cartesian.npz"
FAMILIES = ("n4m3", "n7m6w", "n7m6", "n4m3_gauss")


@pytest.fixture(params=["golden", pytest.param("shared", marks=pytest.mark.slow)], scope="module")
def problems(request):
    """The reference: its golden extract, and all of it where `shared` is there."""
    folder = GOLDEN.parent if request.param == "golden" else request.getfixturevalue("shared") / "reference"
    with np.load(folder / "cartesian.npz") as archive:
        return {name: archive[name] for name in archive.files}


def design(problems, family, **options):
    jacobian, stiffness, low, high = (
        jnp.asarray(problems[f"{family}_{name}"]) for name in ("J", "Kd", "lo", "hi")
    )
    designer = StiffnessDesigner(1.0 / problems["zero_plus"], **options)
    bounds = StiffnessBounds(1.0 / high, 1.0 / low)

    def one(jacobian, stiffness, bounds):
        return designer.design(jacobian, stiffness, bounds)

    run = one if jacobian.ndim == 2 else jax.vmap(one)
    return jax.jit(run)(jacobian, stiffness, bounds)


def apart(ours, theirs) -> float:
    """Return the largest error of matrices, each relative to its largest entry."""
    return float(np.max(np.abs(ours - theirs).max((-2, -1)) / np.abs(theirs).max((-2, -1))))


@pytest.mark.oracle
@pytest.mark.parametrize("family", FAMILIES)
def test_the_reference_problems_are_met(problems, family):
    if f"{family}_J" not in problems:
        pytest.skip(f"{family} is not in the golden extract")
    found = design(problems, family, scaling="none")
    np.testing.assert_allclose(found.joint_compliance, problems[f"{family}_c"], rtol=1e-8)
    np.testing.assert_array_equal(found.working, problems[f"{family}_w"])
    for name, ours in (("Kp", found.passive), ("Ka", found.active), ("Ks", found.active + found.passive)):
        assert apart(np.linalg.inv(ours), problems[f"{family}_{name}"]) < 1e-7
    exact = design(problems, family, scaling="exact", clip=False)
    np.testing.assert_allclose(exact.scale, problems[f"{family}_s_margin"], rtol=1e-10)
    assert apart(np.linalg.inv(exact.active + exact.passive), problems[f"{family}_Kd"]) < 1e-10


@pytest.mark.oracle
@pytest.mark.parametrize("solver", [InteriorPoint(), ActiveSet(), Enumeration()], ids=lambda s: type(s).__name__)
@pytest.mark.parametrize("family", ["cyc4", "cyc7"])
def test_both_problems_that_cycle_as_printed_are_solved(problems, family, solver):
    found = design(problems, family, scaling="none", solver=solver)
    np.testing.assert_allclose(found.joint_compliance, problems[f"{family}_c"], rtol=1e-12)
    assert found.status == Status.SOLVED
    printed = design(problems, family, scaling="none", solver=ActiveSet("drop_first"))
    assert printed.status == Status.NOT_OPTIMAL
    assert printed.optimality > 0.1


FRESH = {"4x3": (4, 3), "7x6": (7, 6), "7x3": (7, 3)}


def fresh(family: str, count: int, seed: int):
    """Return problems: Jacobians of random directions and lengths, stiffness and bounds over a decade."""
    n, m = FRESH[family]
    rng = np.random.default_rng(seed)
    jacobian = rng.normal(0.0, 0.4, (count, m, n))
    if family == "7x3":
        jacobian[:, :, 6] = 0.0  # the last joint of a wrist leaves the hand's position: rank-deficient
    stiffness = np.stack([np.diag(row) for row in rng.uniform(100.0, 1500.0, (count, m))])
    lower = rng.uniform(50.0, 450.0, (count, n))
    return map(jnp.asarray, (jacobian, stiffness, lower, np.full((count, n), 500.0)))


@partial(jax.jit, static_argnames="solver")
def solve_all(jacobian, stiffness, lower, upper, solver=InteriorPoint()):  # noqa: B008
    def one(lane, _):
        jacobian, stiffness, lower, upper = lane
        problem = compliance_problem(jacobian, inverse(stiffness), StiffnessBounds(lower, upper))
        return problem, solver.solve(problem)

    return rollout.map_lanes(one, (jacobian, stiffness, lower, upper))


def check_against_bvls(family: str, count: int, compared: int) -> None:
    problem, solution = solve_all(*fresh(family, count, 7))
    assert solution.optimality.shape == (count,)
    assert float(solution.optimality.max()) <= 1e-12
    for i in range(compared):
        design, target, lower, upper = (np.asarray(part[i]) for part in problem)
        scaled = lsq_linear(design * upper, target, (lower / upper, np.ones_like(lower)), "bvls", tol=1e-15)
        theirs = np.sum((design @ (scaled.x * upper) - target) ** 2)
        ours = np.sum((design @ np.asarray(solution.value[i]) - target) ** 2)
        assert ours <= theirs * (1.0 + 1e-12) + 1e-16 * np.sum(target**2)


@pytest.mark.oracle
@pytest.mark.parametrize("family", FRESH)
def test_fresh_problems_are_optimal_and_no_worse_than_bvls(family):
    check_against_bvls(family, 2048, 100)


@pytest.mark.slow(twin="test_fresh_problems_are_optimal_and_no_worse_than_bvls")
@pytest.mark.oracle
@pytest.mark.parametrize("family", FRESH)
def test_ten_thousand_fresh_problems_are_optimal_and_no_worse_than_bvls(family):
    check_against_bvls(family, 10_000, 10_000)


@pytest.mark.gradient
def test_a_derivative_is_the_slope_of_the_design():
    # Two joints in a plane; nothing changes sides within the step.
    jacobian, direction = jnp.array([[-0.3, -0.2], [0.4, 0.1]]), jnp.array([[0.1, -0.2], [0.3, 0.2]])
    stiffness, bounds = jnp.diag(jnp.array([150.0, 200.0])), StiffnessBounds(jnp.full(2, 5.0), jnp.full(2, 500.0))
    designer = StiffnessDesigner(2000.0)

    def loss(step):
        found = designer.design(jacobian + step * direction, stiffness, bounds)
        return ((found.active + 0.3 * found.passive) / found.desired[0, 0]).sum()

    slope, (before, after) = jax.jit(lambda step: (jax.jacfwd(loss)(0.0), jax.lax.map(loss, step)))(
        jnp.array([-1e-5, 1e-5])
    )
    assert abs(float(slope)) > 0.1
    assert float(slope) == pytest.approx(float(after - before) / 2e-5, rel=1e-6)


@pytest.mark.slow(twin="test_a_derivative_is_the_slope_of_the_design")
@pytest.mark.gradient
def test_derivatives_agree_with_finite_differences_at_300_random_poses():
    # Central differences of a loss of all stages; poses where a bound or an eigenvalue changes sides within the
    # step are no place for a derivative and are left out: both one-sided differences must agree.
    jacobian, stiffness, lower, upper = fresh("4x3", 300, 3)
    designer = StiffnessDesigner(2000.0)
    direction = jnp.asarray(np.random.default_rng(4).normal(0.0, 0.4, (300, 3, 4)))

    def loss(step, jacobian, direction, stiffness, lower, upper):
        found = designer.design(jacobian + step * direction, stiffness, StiffnessBounds(lower, upper))
        share = (found.active / found.desired[0, 0]).sum() + (found.passive / found.desired[0, 0]).sum()
        return share, (found.working, found.joint_compliance)

    lanes = (jacobian, direction, stiffness, lower, upper)
    run = jax.jit(jax.vmap(loss, (None, 0, 0, 0, 0, 0)))
    slope = jax.jit(jax.vmap(lambda *lane: jax.jvp(lambda s: loss(s, *lane)[0], (0.0,), (1.0,))[1]))(*lanes)
    step = 1e-5
    (before, (sets0, _)), (here, (sets1, _)), (after, (sets2, _)) = (run(s, *lanes) for s in (-step, 0.0, step))
    central = (after - before) / (2.0 * step)
    smooth = (sets0 == sets1).all(1) & (sets1 == sets2).all(1)
    smooth = smooth & (jnp.abs(after + before - 2.0 * here) < 1e-7 * (1.0 + jnp.abs(central)))
    assert int(smooth.sum()) > 270
    error = jnp.abs(slope - central) / (1.0 + jnp.abs(central))
    assert float(jnp.where(smooth, error, 0.0).max()) < 1e-6
    backward = jax.grad(lambda s: loss(s, *(lane[0] for lane in lanes))[0])(0.0)
    np.testing.assert_allclose(backward, slope[0], rtol=1e-9)


@pytest.mark.analytic
@pytest.mark.parametrize(
    "size", [2, pytest.param(3, marks=pytest.mark.slow), pytest.param(5, marks=pytest.mark.slow), 6]
)
def test_eigenvalues_and_their_functions_agree_with_lapack(size):
    rng = np.random.default_rng(size)
    matrix = rng.normal(size=(40, size, size))
    matrix = matrix + np.swapaxes(matrix, 1, 2)
    values, vectors = jax.jit(jax.vmap(eigen))(jnp.asarray(matrix))
    np.testing.assert_allclose(np.sort(values, 1), np.linalg.eigvalsh(matrix), atol=1e-13)
    np.testing.assert_allclose((vectors * values[:, None]) @ np.swapaxes(vectors, 1, 2), matrix, atol=1e-13)
    raised = jax.jit(jax.vmap(lambda m: floored(m, 0.1)))(jnp.asarray(matrix))
    assert np.linalg.eigvalsh(raised).min() > 0.1 - 1e-13
    metric = matrix @ matrix + np.eye(size)
    largest = jax.jit(jax.vmap(largest_generalised_eigenvalue))(jnp.asarray(matrix), jnp.asarray(metric))
    theirs = [np.linalg.eigvals(np.linalg.solve(n, m)).real.max() for m, n in zip(matrix, metric, strict=True)]
    np.testing.assert_allclose(largest, theirs, rtol=1e-11)


@pytest.mark.failure
@pytest.mark.parametrize(
    ("change", "status"),
    [
        (lambda j, k, b: (j.at[0, 0].set(jnp.nan), k, b), Status.NOT_FINITE),
        (lambda j, k, b: (j, k.at[1, 1].set(jnp.inf), b), Status.NOT_FINITE),
        (lambda j, k, b: (j, k, StiffnessBounds(b.upper, b.lower)), Status.BAD_BOUNDS),
        (lambda j, k, b: (j, k, StiffnessBounds(-b.lower, b.upper)), Status.BAD_BOUNDS),
        (lambda j, k, b: (j, -k, b), Status.NOT_DEFINITE),
        (lambda j, k, b: (j, k.at[0, 1].set(30.0), b), Status.NOT_DEFINITE),
        (lambda j, k, b: (j, 100.0 * k, b), Status.UNREACHABLE),
        (lambda j, k, b: (j.at[2].set(0.0), k, b), Status.SINGULAR),
        (lambda j, k, b: (j, k, StiffnessBounds(b.lower, b.lower)), Status.SOLVED),
    ],
)
def test_what_has_no_answer_says_so(change, status):
    with np.load(GOLDEN) as given:
        bounds = StiffnessBounds(jnp.asarray(given["t1_kmin"]), jnp.asarray(given["t1_kmax"]))
        found = StiffnessDesigner().design(
            *change(jnp.asarray(given["t1_J"]), jnp.asarray(given["t1_Kd"]), bounds)
        )
    assert found.status == status
    assert Status(int(found.status)).text
    refused = status in (Status.NOT_FINITE, Status.BAD_BOUNDS, Status.NOT_DEFINITE)
    assert np.isnan(found.joint_stiffness).all() == refused
    assert np.isnan(found.serial_stiffness).all() == refused
    assert not (refused and found.is_exact)
    assert np.isnan(found.passive_stiffness).all() == (refused or status == Status.SINGULAR)


@pytest.mark.slow(twin="test_fresh_problems_are_optimal_and_no_worse_than_bvls")
@pytest.mark.equivalence
def test_a_batch_is_its_problems_one_by_one():
    lanes = list(fresh("7x6", 5, 11))
    together = solve_all(*lanes)[1].value
    for i in range(5):
        alone = solve_all(*(lane[i : i + 1] for lane in lanes))[1].value[0]
        np.testing.assert_allclose(together[i], alone, rtol=1e-13)


@pytest.mark.structure
def test_the_batched_solver_calls_no_library():
    text = solve_all.lower(*fresh("4x3", 8, 0)).compile().as_text()
    assert "while" in text
    names = {
        line.split("custom_call_target=")[1].split('"')[1] for line in text.splitlines() if "custom_call_t" in line
    }
    assert not {name for name in names if "potrf" in name or "syevd" in name or "trsm" in name}
