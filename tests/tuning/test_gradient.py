"""The gradient that tuning follows, and that following it leads down."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.tuning.builders import SERIAL, tiny_tuning
from tuning.search.least_squares import GradientTuner
from tuning.search.refine import Search
from tuning.study.loading import load_study
from vsajax.rollout import sensitivity

POINTS = 5


@pytest.fixture(scope="module")
def awas() -> GradientTuner:
    """The AwAS study with all 18 coefficients and its five tuned numbers, over 0.3 s of faster motion."""
    faster = ("excitation.motor.frequency=1.0", "excitation.setpoint_motor.frequency=1.0")
    study = load_study(SERIAL, ["clock.duration=0.3", "scenarios.train=2", "sweep={}", *faster])
    return Search(study, "gradient").tuner


def starts(tuner: GradientTuner, own: dict[str, float]) -> list[jax.Array]:
    """Return the study's own point and random others, each share of its bounds within 12 and 88 %."""
    draws = np.random.default_rng(0).uniform(-2.0, 2.0, (POINTS - 1, tuner.space.size))
    return [tuner.space.unconstrain({k: jnp.asarray(v) for k, v in own.items()}), *map(jnp.asarray, draws)]


@pytest.mark.gradient
def test_the_gradient_matches_central_differences(awas):
    given = awas.given
    objective = jax.jit(lambda z: awas.objective(z, given))
    gradient = jax.jit(jax.jacfwd(lambda z: awas.objective(z, given)))
    # Truncation is h²/6 times third over first derivative, about h² here and 100 h² at worst: 1e-8 to 1e-6.
    # Rounding of an objective that is good to 1e-14 adds 1e-14 / 1e-4 times objective over slope, up to 3000.
    step = 1e-4
    own = Search(awas.problem.study, "gradient").own
    assert awas.space.size == 5
    for z in starts(awas, own):
        differences = [(objective(z + step * e) - objective(z - step * e)) / (2.0 * step) for e in jnp.eye(z.size)]
        exact = np.asarray(gradient(z))
        assert np.all(exact != 0.0)
        np.testing.assert_allclose(exact, differences, rtol=1e-6)


def all_residuals(tuner: GradientTuner, z: jax.Array) -> jax.Array:
    """Return every residual of every scenario, `(scenario, time)`."""
    lanes, common = tuner.given
    values, loop = tuner.space.constrain(z), tuner.problem.residuals
    return jax.vmap(lambda lane: sensitivity.run(loop(values, lane[0], common, lane[1])))(lanes)


@pytest.mark.gradient
@pytest.mark.equivalence
def test_few_residuals_stand_for_all_up_to_the_bounds():
    tuner = Search(tiny_tuning(), "gradient").tuner
    given, count = tuner.given, tuner.problem.study.scenarios.train
    few = jax.jit(lambda z: (tuner.residuals(z, given), jax.jacfwd(tuner.residuals)(z, given)))
    slope = jax.jit(lambda z: (jax.jacfwd(tuner.objective)(z, given), jax.grad(tuner.objective)(z, given)))
    every = jax.jit(lambda z: (all_residuals(tuner, z), jax.jacfwd(lambda z: all_residuals(tuner, z))(z)))
    # The sigmoid of 40 is 1 to the last bit: beyond, nothing moves.
    for z in (jnp.array([0.3, -0.7]), jnp.array([-40.0, 40.0]), jnp.array([40.0, -40.0])):
        (r, jacobian), (whole, of_whole) = few(z), every(z)
        whole, of_whole = whole.reshape(-1), of_whole.reshape(-1, z.size)
        # Sums of 3 × 200 products in another order.
        close = {"rtol": 1e-9, "atol": 1e-12}
        np.testing.assert_allclose(r @ r, whole @ whole / count, **close)
        np.testing.assert_allclose(jacobian.T @ r, of_whole.T @ whole / count, **close)
        np.testing.assert_allclose(jacobian.T @ jacobian, of_whole.T @ of_whole / count, **close)
        for mode in slope(z):
            np.testing.assert_allclose(mode, 2.0 * of_whole.T @ whole / count, **close)


@pytest.mark.structure
@pytest.mark.slow(
    twin=(
        "tests/vsajax/rollout/test_sensitivity.py::test_normal_equations_are_those_of_the_full_jacobian",
        "tests/vsajax/rollout/test_loops.py::test_reverse_memory_grows_with_the_root_of_the_length",
    )
)
def test_memory_grows_neither_with_the_recordings_nor_with_the_residuals():
    def temporary(duration: float) -> int:
        tuner = Search(tiny_tuning(f"clock.duration={duration}", "scenarios.train=4"), "gradient").tuner
        program = jax.jit(lambda z, given: jax.jacfwd(tuner.residuals)(z, given))
        return program.lower(jnp.zeros(2), tuner.given).compile().memory_analysis().temp_size_in_bytes

    # 400 and 10,000 samples in segments of 20 and 100: what one segment of four recordings takes is copied.
    assert temporary(10.0) - temporary(0.4) < 4 * 100 * 10 * 8


@pytest.mark.gradient
@pytest.mark.parametrize("algorithm", ["levenberg-marquardt", pytest.param("bfgs", marks=pytest.mark.slow)])
def test_every_algorithm_leads_down_within_the_bounds(algorithm):
    study = tiny_tuning("clock.duration=1.0", "tune.max_steps=30")
    search = Search(study, "gradient", algorithm)
    tuner, own = search.tuner, search.own
    outcome = tuner.run(own)
    z = tuner.space.unconstrain({path: jnp.asarray(value) for path, value in own.items()})
    before = float(tuner.objective(z, tuner.given))
    assert outcome.start == own
    assert outcome.message in {"converged", "step limit"}
    assert 0 < outcome.steps <= 30
    assert outcome.objective < 0.9 * before
    for path, bounds in study.tune.parameters.items():
        assert bounds.low <= outcome.values[path] <= bounds.high
    # What it reports is the mean score of the training scenarios there.
    values = {path: jnp.asarray(value) for path, value in outcome.values.items()}
    (scenarios, observed), common = tuner.given
    loop = tuner.problem.residuals
    one = jax.jit(jax.vmap(lambda scenario, seen: sensitivity.run(loop(values, scenario, common, seen))))
    again = jnp.sum(one(scenarios, observed) ** 2) / study.scenarios.train
    assert float(again) == pytest.approx(outcome.objective, rel=1e-9)
