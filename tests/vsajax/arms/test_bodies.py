"""Masses of an arm: gravity from its potential, the forces of motion from Lagrange's equations."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vsajax.arms import ArmBodies, SerialArm

JOINTS = 3
STEP = 1e-5


@pytest.fixture(scope="module")
def model():
    rng = np.random.default_rng(0)
    axes = rng.normal(size=(JOINTS, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    turned = Rotation.random(JOINTS, rng=rng).as_matrix()
    root = rng.normal(size=(JOINTS, 3, 3))
    arm = SerialArm(rng.normal(size=(JOINTS, 3)), turned, axes, rng.normal(size=3))
    inertias = root @ np.swapaxes(root, 1, 2)
    return arm, ArmBodies(
        rng.uniform(1.0, 4.0, JOINTS), rng.normal(size=(JOINTS, 3)), inertias, rng.normal(size=3)
    )


def centres(model, q):
    arm, bodies = model
    frames = arm.frames(jnp.asarray(q))[0]
    return np.asarray(frames.position) + np.einsum("bij,bj->bi", frames.rotation, bodies.centres)


def slopes(function, q):
    """Return central differences of a function by each joint, last axis."""
    return np.stack([(function(q + d) - function(q - d)) / (2.0 * STEP) for d in STEP * np.eye(q.size)], -1)


@pytest.mark.gradient
def test_gravity_is_the_slope_of_the_potential(model):
    arm, bodies = model
    q = np.random.default_rng(1).uniform(-3.0, 3.0, JOINTS)

    def potential(q):
        return -float((np.asarray(bodies.masses) * (centres(model, q) @ np.asarray(bodies.gravity))).sum())

    np.testing.assert_allclose(bodies.load(arm, jnp.asarray(q)), slopes(potential, q), atol=1e-8)
    by_load = slopes(lambda q: np.asarray(bodies.load(arm, jnp.asarray(q))), q)
    np.testing.assert_allclose(eqx.filter_jit(bodies.load_stiffness)(arm, jnp.asarray(q)), by_load, atol=1e-7)


@pytest.mark.gradient
def test_inertia_gives_the_bodies_kinetic_energy(model):
    arm, bodies = model
    rng = np.random.default_rng(2)
    q, rate = rng.uniform(-3.0, 3.0, JOINTS), rng.normal(size=JOINTS)
    velocity = (centres(model, q + STEP * rate) - centres(model, q - STEP * rate)) / (2.0 * STEP)
    energy = 0.5 * (np.asarray(bodies.masses) * (velocity**2).sum(1)).sum()
    before, after = (np.asarray(arm.frames(jnp.asarray(q + s * STEP * rate))[0].rotation) for s in (-1.0, 1.0))
    for b in range(JOINTS):
        spin = Rotation.from_matrix(before[b].T @ after[b]).as_rotvec() / (2.0 * STEP)
        energy += 0.5 * spin @ np.asarray(bodies.inertias[b]) @ spin
    np.testing.assert_allclose(
        0.5 * rate @ np.asarray(bodies.inertia(arm, jnp.asarray(q))) @ rate, energy, rtol=1e-8
    )


@pytest.mark.gradient
def test_the_torques_of_motion_are_those_of_christoffel(model):
    arm, bodies = model
    rng = np.random.default_rng(3)
    q, rate = rng.uniform(-3.0, 3.0, JOINTS), rng.normal(size=JOINTS)
    slope = slopes(lambda q: np.asarray(bodies.inertia(arm, jnp.asarray(q))), q)  # M_ij by q_k
    expected = np.einsum("ijk,j,k->i", slope, rate, rate) - 0.5 * np.einsum("jki,j,k->i", slope, rate, rate)
    np.testing.assert_allclose(
        eqx.filter_jit(bodies.motion_torque)(arm, jnp.asarray(q), jnp.asarray(rate)),
        expected,
        rtol=1e-6,
        atol=1e-7,
    )
