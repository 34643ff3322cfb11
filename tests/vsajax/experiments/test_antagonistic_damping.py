"""An antagonistic joint in the loop, which learns the springs that it contracts."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.vsajax.swings import CONTROLLERS, DAMPING, INERTIA, KEY, SOFT, STIFF
from vsajax import SwingScorer, plants, sensing
from vsajax import estimators as es
from vsajax.experiments import antagonistic_damping

SPRING = plants.HyperbolicSpring(0.002, 9.0)
MOTOR = plants.Motor(2e-4, 0.05)


def loop(
    believed: float = 1.0, impulse: float = 0.02, estimates: float = 1.0
) -> antagonistic_damping.AntagonisticLoop:
    """Return law (23) on sinh springs, believed to be a multiple of what they are."""
    side = es.StiffnessEstimator(
        torque=es.ResidualTorque(300.0, MOTOR.inertia, MOTOR.damping),
        basis=es.SeparableOddPolynomial(0.5, deflection_terms=4),
        fit=es.RecursiveLeastSquares(10.0),
        gate=es.ExcitationGate(0.2, 3.0),
        deflection="raw",
        matched=True,
    )
    wrong = plants.HyperbolicSpring(believed * SPRING.torque_scale, SPRING.exponent)
    return antagonistic_damping.AntagonisticLoop(
        joint=plants.AntagonisticJoint(plants.Link(INERTIA, DAMPING), MOTOR, MOTOR, SPRING, SPRING),
        servo=antagonistic_damping.PositionServo(100.0, 0.1),
        controller=CONTROLLERS["law"],
        impact=sensing.Impact(impulse),
        scorer=SwingScorer(0.03),
        clock=sensing.Clock(1e-3, 1.0),
        estimator=es.AntagonisticPair(side),
        believed1=wrong,
        believed2=wrong,
        soft=SOFT,
        stiff=STIFF,
        start=SOFT,
        uses_estimate=estimates,
    )


simulate = eqx.filter_jit(antagonistic_damping.simulate)


@pytest.mark.analytic
def test_a_contraction_gives_the_stiffness_that_is_asked_for():
    zero, wanted = jnp.zeros(()), jnp.asarray(0.7)
    delta = antagonistic_damping.contraction(lambda d: 2.0 * SPRING.stiffness(zero, d), wanted, jnp.asarray(0.8))
    # 2 k a cosh(a δ) = 0.7.
    assert delta == pytest.approx(np.arccosh(0.7 / (2 * 0.002 * 9.0)) / 9.0, abs=1e-5)
    assert antagonistic_damping.contraction(lambda d: d, jnp.asarray(9.0), jnp.asarray(0.8)) == pytest.approx(
        0.8, abs=1e-4
    )


@pytest.mark.analytic
def test_a_joint_that_nothing_hits_stays_where_it_is():
    motion = simulate(loop(impulse=0.0, estimates=0.0), key=KEY)
    assert np.abs(motion.position).max() < 1e-9
    # At rest law (23) is stiff. The springs push the motors in: less than is asked for, by the servos' deflection.
    assert motion.contraction[-1] == pytest.approx(float(motion.contraction[-200]), abs=1e-6)
    assert 0.9 * STIFF < motion.given[-1] < STIFF


@pytest.mark.analytic
def test_springs_that_are_learnt_give_what_is_asked_for():
    learnt, wrong = (simulate(loop(1.6, estimates=uses), key=KEY) for uses in (1.0, 0.0))
    late = np.asarray(learnt.time) > 0.5

    def reached(motion) -> float:
        return float(np.asarray(motion.given)[late].max())

    # Believed 1.6 times as strong, 1 N·m/rad comes out as 0.625; the polynomial and the servo cost some percent.
    assert reached(wrong) == pytest.approx(STIFF / 1.6, rel=0.04)
    assert reached(learnt) == pytest.approx(STIFF, rel=0.08)
    known = np.asarray(learnt.known) > 0
    assert 0.0 < float(learnt.time[known][0]) < 0.2
    assert not np.asarray(wrong.known).any()


@pytest.mark.failure
def test_estimators_whose_springs_cannot_be_read_off_are_refused():
    pair = es.AntagonisticPair(eqx.tree_at(lambda side: side.torque, loop().estimator.side, es.SensorTorque()))
    with pytest.raises(TypeError, match="on a ResidualTorque"):
        eqx.tree_at(lambda own: own.estimator, loop(), pair).__check_init__()


@pytest.mark.slow(twin="test_springs_that_are_learnt_give_what_is_asked_for")
@pytest.mark.analytic
def test_a_wrong_belief_costs_and_the_score_says_how_good_the_estimate_was():
    score = jax.jit(lambda own: antagonistic_damping.score(own, key=KEY))
    known, wrong, learnt = (score(loop(f, estimates=e)) for f, e in ((1.0, 0.0), (1.6, 0.0), (1.6, 1.0)))
    assert wrong.swing.log_energy > 1.1 * known.swing.log_energy
    assert 0.0 < learnt.msrep < 10.0
    assert np.isnan(wrong.msrep)
    assert wrong.known_time == np.inf
