"""Without damping, every joint conserves its energy: forces and coupling are slopes of one potential."""

import numpy as np
import pytest

from tests.vsajax.builders import PITCH
from tests.vsajax.plants.rigs import constant_torques, refined
from vsajax.plants import (
    CoulombFriction,
    FlexibleJoint,
    LeverSpring,
    Link,
    Motion,
    Motor,
    PolynomialSpring,
    SerialJoint,
)

pytestmark = pytest.mark.analytic

GRAVITY = 2.0
SILENCE = constant_torques(2001, 0.0, 0.0)


def flexible_joint(*, link_friction=None, motor_friction=None) -> FlexibleJoint:
    return FlexibleJoint(
        Link(0.1, 0.0, gravity=GRAVITY, friction=link_friction),
        Motor(2.3e-5, 0.0, gear_ratio=50.0, friction=motor_friction),
        PolynomialSpring([30.0, 800.0]),
        start=1.0,
    )


def common_energy(motion: Motion) -> np.ndarray:
    """Kinetic energy of link and motor, and gravity."""
    kinetic = 0.5 * (0.1 * motion.link_velocity**2 + 2.3e-5 * 50.0**2 * motion.motor_velocity**2)
    return kinetic + GRAVITY * (1.0 - np.cos(motion.link_position))


def polynomial_energy(motion: Motion) -> np.ndarray:
    return 30.0 / 2 * motion.deflection**2 + 800.0 / 4 * motion.deflection**4


def assert_conserved(coarse: np.ndarray, fine: np.ndarray) -> None:
    """Assert that energy swings by a multiple of h² (four times less at half the step) and does not drift."""
    # A symmetric scheme conserves a nearby energy; the next term is (ωh)² = 1e-3 of that.
    assert np.ptp(coarse) / np.ptp(fine) == pytest.approx(4.0, abs=0.02)
    assert np.ptp(fine) < 1e-5 * GRAVITY
    half = len(fine) // 2
    assert np.ptp(fine[half:]) < 1.5 * np.ptp(fine[:half])


def test_flexible_joint_with_gravity():
    energies = []
    for steps in (1, 2):
        motion = refined(flexible_joint(), SILENCE, steps)
        assert np.ptp(polynomial_energy(motion)) > 0.01 * GRAVITY  # the spring takes part
        energies.append(common_energy(motion) + polynomial_energy(motion))
    assert_conserved(*energies)


def test_serial_joint_whose_setpoint_motor_is_driven_back():
    # A light set-point motor is moved by the coupling torque alone; a wrong sign of it would create energy.
    spring = LeverSpring(spring_rate=4000.0, arm=0.1, pitch=PITCH)
    link, motor = Link(0.1, 0.0, gravity=GRAVITY), Motor(2.3e-5, 0.0, gear_ratio=50.0)
    joint = SerialJoint(link, motor, Motor(3e-6, 0.0), spring, setpoint_start=-0.03 / PITCH, start=1.0)
    energies = []
    for steps in (1, 2):
        motion = refined(joint, SILENCE, steps)
        elastic = 4000.0 * (0.1 + PITCH * motion.setpoint_position) ** 2 * np.sin(motion.deflection) ** 2
        moved = 0.5 * 3e-6 * motion.setpoint_velocity**2
        assert np.ptp(moved) > 1e-3 * GRAVITY  # the coupling takes part
        energies.append(common_energy(motion) + elastic + moved)
    assert_conserved(*energies)


def test_dry_friction_takes_the_energy_that_its_power_says():
    joint = flexible_joint(link_friction=CoulombFriction(0.3, 0.2), motor_friction=CoulombFriction(0.004, 0.2))
    motion = refined(joint, SILENCE, 4)
    energy = common_energy(motion) + polynomial_energy(motion)
    power = 0.3 * motion.link_velocity * np.tanh(motion.link_velocity / 0.2)
    # The motor rubs on its own axis, 50 times faster than the joint side.
    power += 50.0 * 0.004 * motion.motor_velocity * np.tanh(motion.motor_velocity / 0.2)
    lost = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * 1e-3)])
    assert lost[-1] > 0.9 * energy[0]
    # The trapezoidal sum errs by (ωT)²/12 of the energy in play at the elastic 31 rad/s; the scheme by less.
    np.testing.assert_allclose(energy + lost, energy[0], rtol=0.0, atol=0.031**2 / 12 * GRAVITY)
