import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.vsajax.plants.rigs import linear_joint, with_friction
from vsajax import plants
from vsajax.plants import CoulombFriction, FlexibleJoint, Link, Motor, Torques, awas
from vsajax.plants.splitting import MechanicalState

JOINTS = {
    "flexible": linear_joint(damping=0.1, motor_damping=1e-3),
    "serial": with_friction(awas()),
    "antagonistic": plants.qbmove(),
}

each_joint = pytest.mark.parametrize("joint", JOINTS.values(), ids=JOINTS.keys())


@pytest.mark.contract
def test_registry_holds_every_joint():
    classes = {cls for _, cls in inspect.getmembers(plants, inspect.isclass)}
    joints = {cls for cls in classes if issubclass(cls, plants.AbstractJoint)}
    assert {type(joint) for joint in JOINTS.values()} == joints - {plants.AbstractJoint}


@pytest.mark.contract
@each_joint
def test_joint_describes_the_same_bodies_everywhere(joint):
    state = joint.rest()
    bodies = len(state.positions)
    silence = Torques.none()
    assert len(state.velocities) == len(joint.damping_rates()) == bodies
    assert len(joint.accelerations(silence)(state.positions)) == bodies
    friction = joint.friction()
    assert friction is None or len(friction(state.velocities)) == bodies


@pytest.mark.contract
@each_joint
def test_joint_left_alone_stays_at_rest(joint):
    silence = jax.tree.map(lambda x: jnp.full(20, x), Torques.none())
    motion = plants.simulate(joint, silence, jnp.asarray(1e-3), substeps=2)
    for name, signal in motion._asdict().items():
        np.testing.assert_array_equal(signal, signal[0], err_msg=name)
        if "velocity" in name or "torque" in name:
            np.testing.assert_array_equal(signal, 0.0, err_msg=name)


@pytest.mark.contract
@pytest.mark.parametrize("name", ["flexible", "serial"])
def test_observation_is_consistent_with_the_spring(name):
    joint = JOINTS[name]
    extra = (jnp.asarray(-40.0),) if len(joint.rest().positions) == 3 else ()
    velocities = (jnp.asarray(1.0), jnp.asarray(2.0), *extra)
    state = MechanicalState((jnp.asarray(0.3), jnp.asarray(0.25), *extra), velocities)
    motion = joint.observe(state, Torques(jnp.asarray(0.7), jnp.asarray(0.0), jnp.asarray(0.0)))
    setpoint = extra[0] if extra else jnp.asarray(0.0)
    assert motion.setpoint_position == setpoint
    assert motion.deflection == motion.link_position - motion.motor_position
    assert motion.elastic_torque == joint.spring.torque(setpoint, motion.deflection)
    assert motion.stiffness == joint.spring.stiffness(setpoint, motion.deflection)
    assert motion.motor_torque == 0.7
    assert (motion.link_velocity, motion.motor_velocity) == (1.0, 2.0)


@pytest.mark.analytic
def test_fastest_rate_is_the_frequency_of_the_elastic_mode():
    joint = linear_joint()
    accelerate = joint.accelerations(Torques.none())
    jacobian = np.array(jax.jacfwd(lambda x: jnp.stack(accelerate(tuple(x))))(jnp.zeros(2)))
    rate = np.sqrt(np.max(-np.linalg.eigvals(jacobian)))
    np.testing.assert_allclose(joint.fastest_rate(joint.spring.rate), rate, rtol=1e-13)


@pytest.mark.analytic
def test_fastest_rate_resolves_dry_friction_where_that_is_faster():
    # 1 N·m over 1e-4 kg·m² and 0.5 rad/s: velocities relax at 2e4 1/s, and a twentieth counts.
    friction = CoulombFriction(1.0, 0.5)
    joint = FlexibleJoint(Link(1e-4, 0.0, friction=friction), Motor(1.0, 0.0), plants.LinearSpring(50.0))
    assert joint.fastest_rate(joint.spring.rate) == pytest.approx(max(0.05 * 2e4, np.sqrt(50.0 * (1e4 + 1.0))))
    assert plants.substeps_for(float(joint.fastest_rate(joint.spring.rate)), 1e-3) == 40


@pytest.mark.analytic
def test_awas_is_the_published_one():
    joint = awas()
    start = joint.rest()
    assert joint.spring.lever(start.positions[2]) == pytest.approx(0.07, rel=1e-12)
    # Theory page: 139.4 N·m/rad at 70 mm, D_θ/B = 43.5 and D_θc/B_c = 1.09e5 1/s, four substeps a millisecond.
    stiffness = joint.spring.stiffness(start.positions[2], jnp.asarray(0.0))
    assert stiffness == pytest.approx(139.4, abs=0.05)
    assert [float(rate) for rate in joint.damping_rates()] == pytest.approx([1.5, 43.5, 1.09e5], rel=3e-3)
    assert plants.substeps_for(float(joint.fastest_rate(jnp.asarray(291.5))), 1e-3) == 4


@pytest.mark.analytic
def test_loaded_link_comes_to_rest_where_spring_and_gravity_balance():
    link = Link(0.1, 1.0, gravity=2.0)
    joint = FlexibleJoint(link, Motor(1e12, 0.0), plants.CubicSpring(3.0, 10.0), start=1.0)
    silence = Torques(*(jnp.zeros(5001),) * 3)
    motion = plants.simulate(joint, silence, jnp.asarray(1e-3), substeps=1)
    # q̈ + 10 q̇ + (σ + g')/M q = 0 is underdamped: everything dies with e^(−5t), 1e-11 after 5 s. The scheme's
    # equilibria are those of the joint, and a motor of 1e12 kg·m² does not move.
    assert motion.motor_position[-1] == pytest.approx(1.0, abs=1e-10)
    assert motion.link_position[-1] < 0.8
    balance = motion.elastic_torque[-1] + 2.0 * jnp.sin(motion.link_position[-1])
    assert abs(balance) < 1e-9


@pytest.mark.analytic
def test_friction_opposes_motion_and_is_full_beyond_a_few_velocity_scales():
    friction = CoulombFriction(0.4, 0.05)
    np.testing.assert_allclose(friction(jnp.asarray([-1.0, 0.0, 1.0])), [-0.4, 0.0, 0.4], rtol=1e-15)
    assert friction(jnp.asarray(2.65 * 0.05)) > 0.99 * 0.4
