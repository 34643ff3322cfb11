import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.oracles import residual
from tests.vsajax.builders import PITCH, quantise, residual_torque
from vsajax import MissingSignalError, Sample, rollout
from vsajax.estimators import Kinematics, ModelTorque, ResidualTorque, SensorTorque
from vsajax.plants import LeverSpring

MOTOR = {"inertia": 2.3e-5, "damping": 0.001, "gear_ratio": 50.0}


def run(source, dt, torque, position, velocity):
    """Return the source's torque for given motor kinematics."""
    zero = jnp.zeros_like(jnp.asarray(dt))

    def step(state, inputs):
        dt, torque, position, velocity = inputs
        sample = Sample(dt, motor_position=position, motor_torque=torque)
        return source.step(state, sample, Kinematics(zero[0], zero[0], position, velocity))

    inputs = tuple(map(jnp.asarray, (dt, torque, position, velocity)))
    first = Sample(inputs[0][0], motor_position=inputs[2][0], motor_torque=inputs[1][0])
    return np.asarray(jax.jit(lambda x: rollout.scan(step, source.init(first), x)[1])(inputs))


@pytest.fixture
def motor(golden):
    """Time steps, torque, position and velocity of the AwAS' principal motor."""
    dt = np.concatenate([[0.0], np.full(len(golden["tau"]) - 1, 1e-3)])
    return dt, golden["tau"] + golden["noise_tau"], golden["theta_hat"], golden["dtheta_hat"]


@pytest.mark.oracle
@pytest.mark.parametrize("gain", [30.0, 300.0, 1999.0])
def test_residual_matches_the_printed_formulas(motor, gain):
    dt, torque, position, velocity = motor
    theirs = residual.elastic_torque(torque, position, velocity, dt, gain=gain, **MOTOR)
    # The raw residual reaches K_I·0.1 N·m·s and is differenced: ε times that, twice γ.
    full = 1e-10 * np.max(np.abs(theirs))
    np.testing.assert_allclose(run(residual_torque(gain), *motor), theirs, rtol=0.0, atol=full)


@pytest.mark.oracle
def test_residual_matches_the_printed_formulas_on_an_irregular_clock(motor):
    dt, torque, position, velocity = motor
    dt = dt * np.random.default_rng(5).choice([0.5, 1.0, 3.0], len(dt))
    theirs = residual.elastic_torque(torque, position, velocity, dt, gain=300.0, **MOTOR)
    ours = run(residual_torque(), dt, torque, position, velocity)
    np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-10 * np.max(np.abs(theirs)))


@pytest.mark.oracle
def test_residual_of_the_golden_kinematics_is_the_golden_residual(golden, motor):
    full = np.max(np.abs(golden["torque_residual"]))
    np.testing.assert_allclose(run(residual_torque(), *motor), golden["torque_residual"], atol=1e-9 * full)


@pytest.mark.analytic
def test_residual_is_a_first_order_low_pass_of_the_elastic_torque():
    # A motor held still (θ̇ = 0) by τ_e = −γτ: the residual answers a step with pole (2 − TK)/(2 + TK).
    gain, dt = 300.0, np.concatenate([[0.0], np.full(99, 1e-3)])
    torque = np.full(100, -0.02)
    ours = run(residual_torque(gain), dt, torque, np.zeros(100), np.zeros(100))
    pole = (2 - 0.3) / (2 + 0.3)
    np.testing.assert_allclose(ours, 50.0 * 0.02 * (1 - pole ** np.arange(100)), rtol=1e-12)


@pytest.mark.analytic
def test_dry_friction_of_the_motor_is_taken_off_the_torque():
    # At constant speed the motor torque balances friction alone: no elastic torque must be seen.
    dt = np.concatenate([[0.0], np.full(99, 1e-3)])
    speed, friction = 2.0, 0.015
    source = ResidualTorque(300.0, 2.3e-5, 0.0, 50.0, friction_torque=friction, friction_velocity=0.05)
    ours = run(source, dt, np.full(100, friction), speed * np.cumsum(dt), np.full(100, speed))
    # The residual's start knows no velocity yet: its first sample carries the friction of half an interval of 0.
    np.testing.assert_allclose(ours[60:], 0.0, atol=0.05 * 50 * friction)
    without = run(residual_torque(), dt, np.full(100, friction), np.zeros(100), np.zeros(100))
    assert abs(without[-1]) > 0.99 * 50 * friction


@pytest.mark.analytic
def test_sensor_torque_is_the_reading():
    sample = Sample(jnp.asarray(0.0), elastic_torque=jnp.asarray(1.25))
    kinematics = Kinematics(*(jnp.asarray(0.0),) * 4)
    assert SensorTorque().step((), sample, kinematics) == ((), 1.25)


@pytest.mark.analytic
def test_model_torque_is_the_nominal_law_at_the_measured_kinematics(golden):
    law = LeverSpring(spring_rate=14220.0, arm=0.1, pitch=PITCH)
    setpoint, deflection = jnp.asarray(golden["theta_c"]), jnp.asarray(golden["q"] - golden["theta"])

    def answer(setpoint, deflection):
        zero = jnp.zeros_like(setpoint)
        return ModelTorque(law).step((), Sample(zero), Kinematics(deflection, setpoint, zero, zero))[1]

    ours = jax.vmap(answer)(setpoint, deflection)
    np.testing.assert_allclose(ours, golden["tau_e"], rtol=0.0, atol=1e-12 * np.max(np.abs(golden["tau_e"])))


@pytest.mark.failure
@pytest.mark.parametrize(
    ("source", "missing"),
    [(SensorTorque(), "elastic_torque"), (residual_torque(), "motor_torque")],
    ids=["sensor", "residual"],
)
def test_missing_signal_is_named_with_those_present(source, missing):
    assert missing in source.needs
    zero = jnp.asarray(0.0)
    sample = Sample(zero, link_position=zero, motor_position=zero)
    message = rf"needs the signal {missing}.*it has link_position, motor_position.*another torque source"
    with pytest.raises(MissingSignalError, match=message):
        source.step(source.init(sample), sample, Kinematics(zero, zero, zero, zero))


@pytest.mark.equivalence
def test_residual_does_not_see_a_shift_of_the_encoder(golden):
    dt = np.concatenate([[0.0], np.full(499, 1e-3)])
    position, torque = quantise(golden["theta"][:500], 40000), golden["tau"][:500]
    velocity = golden["dtheta_hat"][:500]
    here, there = (run(residual_torque(), dt, torque, position + shift, velocity) for shift in (0.0, 3.0))
    np.testing.assert_allclose(there, here, rtol=0.0, atol=1e-10 * np.max(np.abs(here)))
