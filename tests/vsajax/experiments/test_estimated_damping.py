"""A damping controller that estimates the spring it commands."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.vsajax.swings import CONTROLLERS, KEY, SOFT, link_plant, loop
from vsajax import estimators as es
from vsajax import plants, sensing
from vsajax.experiments import estimated_damping

LAW = estimated_damping.PresetLaw(0.2, 1.0)


def joint(believed: float = 1.0, noise: float = 0.0, estimates: float = 1.0) -> estimated_damping.EstimatedLoop:
    """Return law (23) from 0.3 to 1 on a spring that is 0.2 + γ, believed to be a multiple of that."""
    actuator = plants.StiffnessActuator(0.2, 1.2, 0.03)
    plant = eqx.tree_at(lambda p: p.actuator, link_plant(travel_time=0.03), actuator)
    hit = loop(CONTROLLERS["law"], plant, duration=2.0, start=SOFT)
    estimator = es.StiffnessEstimator(
        es.SensorTorque(),
        es.SeparableOddPolynomial(setpoint_terms=2),
        es.RecursiveLeastSquares(100.0),
        gate=es.ExcitationGate(0.05, 0.05),
        deflection="raw",
    )
    nominal = estimated_damping.PresetLaw(0.2 * believed, believed)
    return estimated_damping.EstimatedLoop(hit, LAW, nominal, estimator, noise, estimates)


run = jax.jit(lambda own: (estimated_damping.simulate(own, key=KEY), estimated_damping.score(own, key=KEY)))


@pytest.mark.analytic
def test_a_wrong_belief_costs_and_an_estimate_gives_it_back():
    known = run(joint(estimates=0.0))[1]
    wrong = run(joint(1.6, estimates=0.0))[1]
    learnt = run(joint(1.6, 0.01))[1]
    assert wrong.swing.settling_time > 1.1 * known.swing.settling_time
    assert learnt.swing.log_energy < 0.5 * (known.swing.log_energy + wrong.swing.log_energy)
    assert learnt.msrep < 0.1
    assert 0.0 < learnt.known_time < 0.1
    assert np.isnan(wrong.msrep)
    assert wrong.known_time == np.inf


@pytest.mark.analytic
def test_the_stiffness_asked_for_is_given_once_the_spring_is_known():
    motion, _ = run(joint(1.6, 1e-4))
    late = np.asarray(motion.time) > 0.3
    stiffness = np.asarray(motion.stiffness)[late]
    assert (stiffness.min(), stiffness.max()) == pytest.approx((0.3, 1.0), rel=1e-3)
    wrong = np.asarray(run(joint(1.6, estimates=0.0))[0].stiffness)[late]
    # Believed 1.6 times too large: 0.3 asks for γ = 0, which is 0.2, and 1 for γ = 0.425.
    assert (wrong.min(), wrong.max()) == pytest.approx((0.2, 0.625), rel=1e-6)


@pytest.mark.analytic
def test_presets_are_inverted_within_their_range():
    stiffness = jnp.array([0.1, 0.2, 0.7, 1.2, 9.0])
    np.testing.assert_allclose(jax.vmap(LAW.preset)(stiffness), [0.0, 0.0, 0.5, 1.0, 1.0])
    assert LAW.stiffness(jnp.asarray(0.5)) == pytest.approx(0.7)


@pytest.mark.failure
def test_a_sensor_that_nothing_would_read_is_refused():
    own = joint()
    sensed = loop(CONTROLLERS["law"], own.loop.plant, sensor=sensing.FeedbackSensor(noise_std=1e-3))
    with pytest.raises(ValueError, match="give its loop no sensor"):
        estimated_damping.EstimatedLoop(sensed, LAW, LAW, own.estimator, 0.0)
