"""The agonist-antagonist joint against SciPy's Radau, and the stiff motor friction that it must survive."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from vsajax import plants
from vsajax.plants import Torques

SAMPLE_TIME, DURATION = 1e-3, 1.0
OFFSETS, AMPLITUDES, FREQUENCIES = (2.5, -2.5), (1.5, 1.5), (0.5, 0.7)


def drive(time: np.ndarray) -> Torques:
    both = [o + a * np.sin(2 * np.pi * f * time) for o, a, f in zip(OFFSETS, AMPLITUDES, FREQUENCIES, strict=True)]
    zero = np.zeros_like(time)
    return Torques(*map(jnp.asarray, (zero, zero, zero, *both)))


def run(joint: plants.AntagonisticJoint, substeps: int) -> plants.AntagonisticMotion:
    time = np.arange(round(DURATION / SAMPLE_TIME) + 1) * SAMPLE_TIME
    middles = time[:, None] + SAMPLE_TIME * (np.arange(substeps) + 0.5) / substeps
    simulate = jax.jit(plants.simulate, static_argnames="substeps")
    return simulate(joint, drive(time), jnp.asarray(SAMPLE_TIME), substeps=substeps, midway=drive(middles))


def radau() -> np.ndarray:
    """Return q_L, q₁, q₂ of the cubic joint, (1)–(3) with f = 10 φ³, at the samples."""

    def rates(time: float, x: np.ndarray) -> list[float]:
        link, first, second, *v = x
        f1, f2 = 10.0 * (link - first) ** 3, 10.0 * (link - second) ** 3
        t1, t2 = (
            o + a * np.sin(2 * np.pi * f * time) for o, a, f in zip(OFFSETS, AMPLITUDES, FREQUENCIES, strict=True)
        )
        return [
            *v,
            (-0.0127 * v[0] - f1 - f2) / 0.0179,
            (t1 - 1.27 * v[1] + f1) / 1e-4,
            (t2 - 1.27 * v[2] + f2) / 1e-4,
        ]

    samples = np.arange(round(DURATION / SAMPLE_TIME) + 1) * SAMPLE_TIME
    return solve_ivp(rates, (0.0, DURATION), np.zeros(6), "Radau", samples, rtol=1e-11, atol=1e-13).y[:3]


@pytest.mark.oracle
def test_motion_is_that_of_radau():
    motion = run(plants.menard_cubic(), 64)
    found = np.stack([motion.link_position, motion.motor1_position, motion.motor2_position])
    # Second order: 2.3e-7 rad at 4 steps a millisecond, 256 times less at 64.
    np.testing.assert_allclose(found, radau(), atol=2e-9)


@pytest.mark.order
def test_steps_that_make_runge_kutta_unstable_converge_with_order_two():
    # b/J = 12,700 1/s: at 1 to 4 steps a millisecond explicit RK4 ends in a finite limit cycle.
    exact, steps = radau()[1], np.array([1, 2, 4])
    errors = [
        np.max(np.abs(np.asarray(run(plants.menard_cubic(), int(n)).motor1_position) - exact)) for n in steps
    ]
    assert -np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.35)


@pytest.mark.contract
@pytest.mark.parametrize("preset", [plants.menard_cubic, plants.vsa_exponential, plants.qbmove])
def test_presets_move_and_sum_their_sides(preset):
    motion = run(preset(), 8)
    assert np.isfinite(motion.link_position).all()
    assert np.ptp(np.asarray(motion.motor1_position)) > 1e-3
    np.testing.assert_allclose(motion.stiffness, motion.stiffness_1 + motion.stiffness_2, rtol=1e-15)
