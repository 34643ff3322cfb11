"""Planar arms against Lagrange's equations, differentiated by JAX from the positions of the masses alone."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vsajax import plants
from vsajax.numerics import solve_definite

each_size = pytest.mark.parametrize("joints", [1, 2, 3])


def random_arm(joints: int, gravity: float | None = 9.81, damping: bool = True) -> plants.PlanarArm:
    rng = np.random.default_rng(joints)
    links = []
    for _ in range(joints):
        mass, length, inertia, friction = rng.uniform(0.1, 1.0, 4)
        links.append(plants.ArmLink(mass, length, rng.uniform(0.2, 1.0) * length, inertia, friction * damping))
    return plants.PlanarArm(tuple(links), gravity)


def random_state(joints: int, seed: int = 0) -> tuple[tuple[jax.Array, ...], ...]:
    values = np.random.default_rng(seed).normal(size=(3, joints))
    return tuple(tuple(map(jnp.asarray, row)) for row in values)


def lagrangian(arm: plants.PlanarArm, q, v):
    """Return T − U from where each centre of mass is, hanging down at 0; velocities by differentiation."""

    def centres(q):
        angles, places, base = jnp.cumsum(q), [], jnp.zeros(2)
        for link, angle in zip(arm.links, angles, strict=True):
            way = jnp.array([jnp.sin(angle), -jnp.cos(angle)])
            places.append(base + link.centre * way)
            base = base + link.length * way
        return jnp.stack(places)

    speeds = jax.jvp(centres, (q,), (v,))[1]
    masses = jnp.array([link.mass for link in arm.links])
    inertias = jnp.array([link.inertia for link in arm.links])
    kinetic = 0.5 * jnp.sum(masses * jnp.sum(speeds**2, axis=1)) + 0.5 * jnp.sum(inertias * jnp.cumsum(v) ** 2)
    return kinetic - jnp.sum(masses * (arm.gravity or 0.0) * centres(q)[:, 1])


@pytest.mark.oracle
@each_size
def test_accelerations_are_lagranges(joints):
    arm, (q, v, torques) = random_arm(joints), random_state(joints)
    position, velocity = jnp.stack(q), jnp.stack(v)

    @jax.jit
    def derivatives(q, v):
        mass = jax.hessian(lagrangian, 2)(arm, q, v)
        turning = jax.jacfwd(jax.grad(lagrangian, 2), 1)(arm, q, v) @ v
        return mass, jax.grad(lagrangian, 1)(arm, q, v) - turning

    mass, pull = derivatives(position, velocity)
    drag = jnp.array([link.damping for link in arm.links]) * velocity
    right = jnp.stack(torques) - drag + pull
    np.testing.assert_allclose(arm.accelerations(q, v, torques), jnp.linalg.solve(mass, right), rtol=1e-9)
    np.testing.assert_allclose(arm.kick(q, torques), jnp.linalg.solve(mass, jnp.stack(torques)), rtol=1e-9)


@pytest.mark.analytic
@each_size
def test_energy_is_that_of_the_lagrangian_and_is_conserved(joints):
    arm, (q, v, _) = random_arm(joints, damping=False), random_state(joints)
    still = jnp.zeros(joints)
    # T + U, with L at rest as −U and its value hanging down as the zero.
    energy = lagrangian(arm, jnp.stack(q), jnp.stack(v)) - 2.0 * lagrangian(arm, jnp.stack(q), still)
    energy = energy + lagrangian(arm, still, still)
    np.testing.assert_allclose(arm.energy(q, v), energy, rtol=1e-12)
    none = (jnp.zeros(()),) * joints
    _, change = jax.jvp(arm.energy, (q, v), (v, arm.accelerations(q, v, none)))
    np.testing.assert_allclose(change, 0.0, atol=1e-9)


@pytest.mark.analytic
@each_size
def test_tip_impulse_does_the_work_of_its_force(joints):
    arm, (q, v, _) = random_arm(joints), random_state(joints)

    def tip(q):
        angles = jnp.cumsum(q)
        lengths = jnp.array([link.length for link in arm.links])
        return jnp.array([jnp.sum(lengths * jnp.sin(angles)), -jnp.sum(lengths * jnp.cos(angles))])

    speed = jax.jvp(tip, (jnp.stack(q),), (jnp.stack(v),))[1]
    last = jnp.sum(jnp.stack(q))
    across = jnp.array([jnp.cos(last), jnp.sin(last)])
    work = sum(p * w for p, w in zip(arm.tip_impulse(q, jnp.asarray(0.7)), v, strict=True))
    np.testing.assert_allclose(work, 0.7 * across @ speed, rtol=1e-12)


@pytest.mark.analytic
def test_a_single_link_is_an_arm_of_one():
    link = plants.SingleLink(plants.Link(0.3, 0.1, gravity=0.5 * 9.81 * 0.4))
    arm = plants.PlanarArm((plants.ArmLink(0.5, 1.0, 0.4, 0.3 - 0.5 * 0.16, 0.1),), 9.81)
    q, v, torque = random_state(1)
    np.testing.assert_allclose(link.accelerations(q, v, torque), arm.accelerations(q, v, torque), rtol=1e-12)
    np.testing.assert_allclose(link.energy(q, v), arm.energy(q, v), rtol=1e-12)
    np.testing.assert_allclose(link.kick(q, torque), arm.kick(q, torque), rtol=1e-12)


@pytest.mark.analytic
@pytest.mark.parametrize("size", [1, 2, 3, 4])
def test_definite_systems_are_solved(size):
    rng = np.random.default_rng(size)
    root, right = rng.normal(size=(size, size)), rng.normal(size=size)
    matrix = root @ root.T + 0.1 * np.eye(size)
    rows = [list(map(jnp.asarray, row)) for row in matrix]
    found = solve_definite(rows, list(map(jnp.asarray, right)))
    np.testing.assert_allclose(found, np.linalg.solve(matrix, right), rtol=1e-9)


@pytest.mark.failure
def test_four_links_are_refused():
    link = plants.ArmLink(1.0, 1.0, 0.5, 0.1)
    with pytest.raises(ValueError, match="one to three links; got 4"):
        plants.PlanarArm((link,) * 4)
