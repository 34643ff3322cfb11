import jax.numpy as jnp
import numpy as np
import pytest

from tests.vsajax.builders import SAMPLE_TIME
from tests.vsajax.plants.rigs import constant_torques, refined, smooth_torques, with_friction
from vsajax.plants import CubicSpring, FlexibleJoint, Link, Motor, awas, substeps_for

SAMPLES = 301
# λ = 1e5 1/s on the link: λh is 100 to 25 over the refinements, and 3 in the reference.
OVERDAMPED = FlexibleJoint(Link(1e-6, 0.1), Motor(1.0, 1.0), CubicSpring(50.0, 1000.0))

CASES = {
    "constant torques": (awas(), constant_torques(SAMPLES)),
    "smooth torques": (awas(), smooth_torques(SAMPLES)),
    "dry friction": (with_friction(awas()), smooth_torques(SAMPLES)),
    "overdamped link": (OVERDAMPED, smooth_torques(SAMPLES)),
}


@pytest.mark.order
@pytest.mark.parametrize(("joint", "torques"), CASES.values(), ids=CASES.keys())
def test_positions_converge_with_order_two(joint, torques):
    refinements = np.array([1, 2, 4])
    best = refined(joint, torques, 32)
    for name in ("link_position", "motor_position"):
        errors = [
            np.max(np.abs(getattr(refined(joint, torques, n), name) - getattr(best, name))) for n in refinements
        ]
        order = -np.polyfit(np.log2(refinements), np.log2(errors), 1)[0]
        # The reference's own error, 1/64 of the finest one, biases the slope by 0.01.
        assert abs(order - 2.0) < 0.1, f"{name}: order {order:.3f} from errors {errors}"


@pytest.mark.analytic
@pytest.mark.parametrize("steps", [1, 4])
def test_overdamped_body_under_a_ramp_errs_by_half_a_step_of_velocity(steps):
    # With λh ≫ 1 the velocity follows the acceleration of mid-step: it lags by a'h/(2λ), which moves the position
    # by a'h/(2λ²) and no more, however long the ramp. First order, but 4e-7 rad for the AwAS at four steps.
    joint = awas()
    motor = joint.setpoint_motor
    slope = 100.0 / (motor.inertia * motor.gear_ratio)
    rate = float(motor.damping / motor.inertia)
    torques = constant_torques(SAMPLES, motor=0.0, external=0.0)
    torques = torques._replace(setpoint_motor=100.0 * SAMPLE_TIME * jnp.arange(SAMPLES))
    time = np.arange(SAMPLES) * SAMPLE_TIME
    # x' = v, v' = −λv + a't from rest: x = a'(t²/(2λ) − t/λ² + (1 − e^(−λt))/λ³).
    exact = slope * (time**2 / (2 * rate) - time / rate**2 - np.expm1(-rate * time) / rate**3)
    travel = refined(joint, torques, steps).setpoint_position - float(joint.setpoint_start)
    lag = slope * (SAMPLE_TIME / steps) / (2 * rate**2)
    # The body reaches mid-step velocity up to e^(−λh) and 2/λh: 8 % at four steps. 75 rad round to 1e-14 a step.
    assert np.max(np.abs(travel - exact)) == pytest.approx(float(lag), rel=0.1)


@pytest.mark.analytic
@pytest.mark.parametrize(("rate", "expected"), [(88.0, 4), (25.0, 1), (25.1, 2), (0.0, 1)])
def test_substeps_resolve_the_fastest_rate(rate, expected):
    assert substeps_for(rate, SAMPLE_TIME) == expected


@pytest.mark.analytic
def test_substeps_follow_the_asked_resolution():
    assert substeps_for(100.0, SAMPLE_TIME, resolution=0.1) == 1
    assert substeps_for(100.0, SAMPLE_TIME, resolution=0.01) == 10
