import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.vsajax.builders import SAMPLE_TIME
from tests.vsajax.plants.rigs import constant_torques, linear_joint, refined, smooth_torques, with_friction
from vsajax import plants
from vsajax.plants import AbstractJoint, Motion, Torques, awas

SAMPLES = 101
TORQUES = smooth_torques(SAMPLES)


@eqx.filter_jit
def simulate(joint: AbstractJoint, torques: Torques, dt: jax.Array, **options: int) -> Motion:
    return plants.simulate(joint, torques, dt, **options)


def assert_same(left: Motion, right: Motion) -> None:
    # The same sums in another order: 400 steps round angles of 75 rad by ε/2, the lever turns that into torque.
    for name, a, b in zip(Motion._fields, left, right, strict=True):
        np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-11 * np.max(np.abs(a)), err_msg=name)


@pytest.mark.equivalence
def test_substeps_are_a_finer_grid_under_interpolated_torques():
    joint = with_friction(awas())
    assert_same(simulate(joint, TORQUES, jnp.asarray(SAMPLE_TIME), substeps=4), refined(joint, TORQUES, 4))


@pytest.mark.equivalence
def test_intervals_that_happen_to_be_equal_are_a_regular_clock():
    joint = with_friction(awas())
    intervals = jnp.full(SAMPLES - 1, SAMPLE_TIME)
    assert_same(
        simulate(joint, TORQUES, intervals, substeps=2),
        simulate(joint, TORQUES, jnp.asarray(SAMPLE_TIME), substeps=2),
    )


@pytest.mark.equivalence
@pytest.mark.parametrize("segment", [1, 7, 101, 500])
def test_segments_do_not_change_the_motion(segment):
    whole = simulate(awas(), TORQUES, jnp.asarray(SAMPLE_TIME), substeps=1)
    assert_same(simulate(awas(), TORQUES, jnp.asarray(SAMPLE_TIME), substeps=1, segment=segment), whole)


@pytest.mark.equivalence
def test_population_of_joints_is_a_loop_over_joints():
    joints = [eqx.tree_at(lambda j: j.spring.spring_rate, awas(), jnp.asarray(k)) for k in (1e4, 1.4e4, 2e4)]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *joints)
    together = eqx.filter_vmap(lambda j: simulate(j, TORQUES, jnp.asarray(SAMPLE_TIME), substeps=1))(stacked)
    for i, joint in enumerate(joints):
        alone = simulate(joint, TORQUES, jnp.asarray(SAMPLE_TIME), substeps=1)
        assert_same(jax.tree.map(lambda x, i=i: x[i], together), alone)


@pytest.mark.analytic
def test_irregular_clock_integrates_a_free_body_exactly():
    # λh varies from 0.2 to 20: a clock that mistook one interval for another would show at once.
    intervals = np.random.default_rng(3).uniform(1e-3, 0.1, 60)
    time = np.concatenate([[0.0], np.cumsum(intervals)])
    motion = simulate(
        linear_joint(rate=0.0, damping=20.0), constant_torques(61), jnp.asarray(intervals), substeps=1
    )
    rate, drive = 200.0, 5.0 / 0.1
    np.testing.assert_allclose(motion.link_velocity, -drive / rate * np.expm1(-rate * time), rtol=1e-13)
    position = drive * (time / rate + np.expm1(-rate * time) / rate**2)
    np.testing.assert_allclose(motion.link_position, position, rtol=1e-13, atol=1e-16)


def tuned(joint: AbstractJoint) -> tuple[jax.Array, ...]:
    return joint.spring.spring_rate, joint.motor.damping, joint.link.inertia, joint.motor.friction.torque


@pytest.mark.gradient
def test_gradients_through_the_plant_match_finite_differences():
    joint = with_friction(awas())

    def mean_square(log_scale: jax.Array) -> jax.Array:
        scaled = tuple(jnp.exp(s) * v for s, v in zip(log_scale, tuned(joint), strict=True))
        varied = eqx.tree_at(tuned, joint, scaled)
        motion = plants.simulate(varied, TORQUES, jnp.asarray(SAMPLE_TIME), substeps=1)
        return jnp.mean(motion.deflection**2) * 1e4

    at, step = jnp.zeros(4), 1e-3
    forward, reverse = jax.jit(jax.jacfwd(mean_square))(at), jax.jit(jax.grad(mean_square))(at)
    np.testing.assert_allclose(forward, reverse, rtol=1e-10)
    # Five-point differences of a function with slopes of order one: truncation step⁴ = 1e-12, rounding ε/step.
    offsets = jnp.asarray([-2, -1, 1, 2])[:, None, None] * step * jnp.eye(4)
    values = jax.jit(jax.vmap(jax.vmap(mean_square)))(offsets)
    differences = jnp.asarray([1, -8, 8, -1]) @ values / (12 * step)
    np.testing.assert_allclose(forward, differences, rtol=1e-8)


@pytest.mark.gradient
def test_gradients_at_rest_are_finite_and_absent_parts_have_none():
    silence = constant_torques(30, 0.0, 0.0)

    def last_values(joint: AbstractJoint) -> jax.Array:
        motion = plants.simulate(joint, silence, jnp.asarray(SAMPLE_TIME), substeps=1)
        return motion.link_position[-1] + motion.elastic_torque[-1] + motion.stiffness[-1]

    slopes = jax.jit(jax.grad(last_values))(with_friction(awas()))
    assert slopes.link.gravity is None
    assert np.all(np.isfinite(jax.tree.leaves(slopes)))
    # σ = 2 k_s r² depends on the spring even at rest.
    assert slopes.spring.spring_rate == pytest.approx(2 * 0.07**2, rel=1e-12)
