import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vsajax import Recording
from vsajax.estimators import (
    ExcitationGate,
    ExponentialForgetting,
    Polynomial,
    RecursiveLeastSquares,
    SensorTorque,
    StiffnessEstimator,
)
from vsajax.experiments import estimation

pytestmark = pytest.mark.analytic


def answers(gate, deflections, stiffnesses, stds):
    state, known = gate.init(jnp.asarray(deflections[0])), []
    for sample in zip(deflections, stiffnesses, stds, strict=True):
        state, is_known = gate.step(state, *map(jnp.asarray, sample))
        known.append(bool(is_known))
    return known


def test_stiffness_is_known_once_moved_and_tight():
    gate = ExcitationGate(min_deflection_range=0.01, max_relative_std=0.1)
    deflections = [0.50, 0.505, 0.511, 0.505, 0.505, 0.505]
    assert answers(gate, deflections, [100.0] * 6, [1.0, 1.0, 1.0, 11.0, 10.0, 9.9]) == [
        False,
        False,
        True,
        False,
        False,
        True,
    ]


def test_what_has_not_moved_is_never_known():
    assert answers(ExcitationGate(), [0.5] * 3, [100.0] * 3, [0.0, 1e-9, 1.0]) == [False] * 3


def test_range_counts_from_the_smallest_to_the_largest_so_far():
    gate = ExcitationGate(min_deflection_range=0.02, max_relative_std=0.1)
    assert answers(gate, [0.0, 0.011, 0.0, -0.011, 0.0], [1.0] * 5, [0.0] * 5) == [False] * 3 + [True] * 2


def test_std_counts_relative_to_the_size_of_the_stiffness():
    gate = ExcitationGate(max_relative_std=0.1)
    assert answers(gate, [0.0, 0.1, 0.1, 0.1], [100.0, 100.0, 1.0, 0.0], [5.0, 5.0, 5.0, 0.1]) == [
        False,
        True,
        False,
        False,
    ]


def test_a_stiffness_that_is_not_positive_is_never_known():
    for stiffness in (-100.0, -1e-9, 0.0, float("inf"), float("-inf")):
        assert answers(ExcitationGate(), [0.0, 0.1], [stiffness] * 2, [0.0, 1e-12]) == [False] * 2


def test_absent_posterior_is_never_known():
    gate = ExcitationGate()
    nan, inf = float("nan"), float("inf")
    assert answers(gate, [0.0] * 3, [100.0, 100.0, nan], [nan, inf, 1.0]) == [False] * 3


@pytest.mark.analytic
@pytest.mark.parametrize("memory", [0.5, 0.9, 0.99, 0.999])
@pytest.mark.parametrize("dithers", [False, True])
def test_an_hour_at_rest_leaves_finite_numbers_and_a_second_of_motion_the_stiffness(memory, dithers):
    # A reading that stands still to the last digit, or one that dithers between two counts, at 100 Hz.
    count, stiffness = 1e-4, 150.0
    motion, rest = np.arange(0.0, 2.0, 0.01), np.arange(0.0, 3600.0, 0.01)
    moving = 0.02 * np.sin(2 * np.pi * 3.0 * motion)
    noise = np.random.default_rng(0).integers(0, 2, rest.size) if dithers else np.zeros(rest.size)
    deflection = np.concatenate([moving, 0.013 + count * noise, moving])
    jitter = 1e-3 * np.random.default_rng(1).standard_normal(deflection.size)
    jitter[motion.size : motion.size + rest.size] = 0.0
    recording = Recording(
        jnp.arange(deflection.size) * 0.01,
        deflection=jnp.asarray(deflection),
        elastic_torque=jnp.asarray(stiffness * deflection + jitter),
    )
    estimator = StiffnessEstimator(
        SensorTorque(),
        Polynomial(0.02, order=3),
        RecursiveLeastSquares(1e6, ExponentialForgetting(memory)),
        gate=ExcitationGate(0.01, 0.1),
        deflection="measured",
    )
    answer = jax.jit(estimation.estimate)(estimator, recording)
    resting = slice(motion.size, motion.size + rest.size)
    assert np.all(np.isfinite(answer.stiffness))
    assert np.all(np.asarray(answer.stiffness_std)[resting] > 0.0)
    assert not np.any(np.isnan(answer.stiffness_std))
    # Nobody knows a stiffness an hour later; but one that remembers enough samples for its coefficients finds it.
    assert not np.any(np.asarray(answer.known)[resting][-1000:])
    if memory > 0.9:
        np.testing.assert_allclose(np.asarray(answer.stiffness)[resting.stop + 100], stiffness, rtol=0.01)
        assert memory < 0.99 or answer.known[resting.stop + 100]
