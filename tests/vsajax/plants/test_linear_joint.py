"""A flexible joint on a linear spring against its closed forms."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

from tests.vsajax.builders import SAMPLE_TIME
from tests.vsajax.plants.rigs import constant_torques, linear_joint, refined
from vsajax import plants
from vsajax.plants import FlexibleJoint, Torques

pytestmark = pytest.mark.analytic

SAMPLES = 1001
MOTOR_TORQUE, EXTERNAL_TORQUE = 0.1, 5.0
LINK_INERTIA, MOTOR_INERTIA = 0.1, 2.3e-5 * 50.0**2
TIME = np.arange(SAMPLES) * SAMPLE_TIME


def closed_form(joint: FlexibleJoint) -> np.ndarray:
    """Return (q, θ, q̇, θ̇) over time from the matrix exponential of ẋ = Ax + b."""
    rate, (damping, motor_damping) = float(joint.spring.rate), map(float, joint.damping_rates())
    system = np.zeros((5, 5))
    system[0, 2] = system[1, 3] = 1.0
    system[2] = [-rate / LINK_INERTIA, rate / LINK_INERTIA, -damping, 0.0, EXTERNAL_TORQUE / LINK_INERTIA]
    drive = 50 * MOTOR_TORQUE / MOTOR_INERTIA
    system[3] = [rate / MOTOR_INERTIA, -rate / MOTOR_INERTIA, 0.0, -motor_damping, drive]
    advance, state, states = expm(system * SAMPLE_TIME), np.array([0.0, 0.0, 0.0, 0.0, 1.0]), []
    for _ in TIME:
        states.append(state[:4])
        state = advance @ state
    return np.array(states).T


@pytest.fixture(scope="module")
def torques() -> Torques:
    return constant_torques(SAMPLES, MOTOR_TORQUE, EXTERNAL_TORQUE)


@pytest.mark.parametrize("steps", [1, 4])
def test_undamped_joint_oscillates_at_the_leapfrog_frequency(torques, steps):
    # Drift–kick–drift from rest is exactly x = c (1 − cos Ωt) with sin(Ωh/2) = ωh/2. Only rounding remains, of
    # positions that reach 32 rad: ε/2 · 32 rad · √4000 steps.
    joint = linear_joint()
    motion = jax.jit(lambda u: plants.simulate(joint, u, jnp.asarray(SAMPLE_TIME), substeps=steps))(torques)
    rate, h = float(joint.fastest_rate(joint.spring.rate)), SAMPLE_TIME / steps
    drive = EXTERNAL_TORQUE / LINK_INERTIA - 50 * MOTOR_TORQUE / MOTOR_INERTIA
    frequency = 2 / h * np.arcsin(rate * h / 2)
    expected = drive / rate**2 * (1 - np.cos(frequency * TIME))
    np.testing.assert_allclose(motion.deflection, expected, rtol=0.0, atol=2.5e-13)
    # What `substeps_for` promises of the frequency.
    assert frequency / rate - 1 == pytest.approx((rate * h) ** 2 / 24, rel=0.01)


def test_undamped_joint_has_the_centre_of_mass_of_a_free_body(torques):
    motion = refined(linear_joint(), torques, 1)
    centre = LINK_INERTIA * motion.link_position + MOTOR_INERTIA * motion.motor_position
    expected = 0.5 * (EXTERNAL_TORQUE + 50 * MOTOR_TORQUE) * TIME**2
    np.testing.assert_allclose(centre, expected, rtol=1e-12)


def test_damped_joint_matches_its_matrix_exponential(torques):
    joint = linear_joint(damping=0.15, motor_damping=1e-3)
    exact = closed_form(joint)
    coarse, fine = (
        np.stack([m.link_position, m.motor_position, m.link_velocity, m.motor_velocity])
        for m in (refined(joint, torques, n) for n in (2, 4))
    )
    error = np.max(np.abs(coarse - exact), axis=1)
    extrapolated = np.max(np.abs((4 * fine - coarse) / 3 - exact), axis=1)
    # ωh = 0.037 in the coarse run: the h² term is (ωh)²ωt/24 of the motion; without it, ωh of that is left.
    assert np.all(error < 0.037**2 * 74 / 24 * np.max(np.abs(exact), axis=1))
    assert np.all(extrapolated < 0.037 * error)


@pytest.mark.parametrize("damping", [0.0, 1e-3, 0.15, 1e4])
def test_unsprung_link_is_integrated_exactly_whatever_its_damping(torques, damping):
    motion = refined(linear_joint(rate=0.0, damping=damping), torques, 1)
    drive, rate = EXTERNAL_TORQUE / LINK_INERTIA, damping / LINK_INERTIA
    if damping == 0.0:
        velocity, position = drive * TIME, 0.5 * drive * TIME**2
    else:
        x = np.longdouble(rate) * TIME
        velocity = -drive / rate * np.expm1(-x)
        # x + expm1(−x) cancels to x²/2: by series where x is small.
        series = sum((-x) ** i / math.factorial(i + 2) for i in range(12))
        position = np.where(x < 0.1, drive * TIME**2 * series, drive / rate**2 * (x + np.expm1(-x)))
    # A thousand steps, each rounding by ε.
    np.testing.assert_allclose(motion.link_velocity, velocity, rtol=2e-13)
    np.testing.assert_allclose(motion.link_position, position, rtol=2e-13)


def test_first_order_hold_integrates_a_ramp_of_torque_to_second_order():
    # An undamped free link under τ = t: x = t³/6M. Mid-step forces integrate it with an error of h²t/(12M).
    samples = 101
    zeros = jnp.zeros(samples)
    motion = refined(linear_joint(rate=0.0), Torques(zeros, zeros, SAMPLE_TIME * jnp.arange(samples)), 1)
    time = TIME[:samples]
    expected = (time**3 / 6 + SAMPLE_TIME**2 * time / 12) / LINK_INERTIA
    np.testing.assert_allclose(motion.link_position, expected, rtol=1e-11, atol=1e-18)
