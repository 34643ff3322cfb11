"""Kinematics of any serial arm against products of homogeneous matrices and finite differences."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vsajax.arms import SerialArm, rotation_about, scaled_rows

JOINTS = 5
STEP = 1e-5


@pytest.fixture(scope="module")
def arm():
    """An arm of no particular shape."""
    rng = np.random.default_rng(0)
    axes = rng.normal(size=(JOINTS, 3))
    turned = Rotation.random(JOINTS + 1, rng=rng).as_matrix()
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return SerialArm(rng.normal(size=(JOINTS, 3)), turned[:-1], axes, rng.normal(size=3), turned[-1])


@pytest.fixture(scope="module")
def poses():
    return jnp.asarray(np.random.default_rng(1).uniform(-np.pi, np.pi, (20, JOINTS)))


def homogeneous(rotation, offset) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, offset
    return matrix


def hand_by_matrices(arm: SerialArm, positions: np.ndarray) -> np.ndarray:
    total = np.eye(4)
    for offset, rotation, axis, q in zip(arm.offsets, arm.rotations, arm.axes, positions, strict=True):
        total = total @ homogeneous(rotation, offset)
        total = total @ homogeneous(Rotation.from_rotvec(q * np.asarray(axis)).as_matrix(), np.zeros(3))
    return total @ homogeneous(arm.tool_rotation, arm.tool_offset)


@pytest.mark.oracle
def test_the_hand_is_where_the_product_of_matrices_puts_it(arm, poses):
    found = jax.jit(jax.vmap(arm.forward))(poses)
    expected = np.stack([hand_by_matrices(arm, q) for q in poses])
    np.testing.assert_allclose(found.position, expected[:, :3, 3], atol=1e-13)
    np.testing.assert_allclose(found.rotation, expected[:, :3, :3], atol=1e-13)


@pytest.mark.gradient
def test_the_jacobian_is_the_hands_motion(arm, poses):
    found = np.asarray(jax.jit(jax.vmap(arm.jacobian))(poses))
    for q, jacobian in zip(poses, found, strict=True):
        for i, change in enumerate(STEP * np.eye(JOINTS)):
            after, before = hand_by_matrices(arm, q + change), hand_by_matrices(arm, q - change)
            turned = Rotation.from_matrix(after[:3, :3] @ before[:3, :3].T).as_rotvec()
            moved = np.concatenate([after[:3, 3] - before[:3, 3], turned]) / (2.0 * STEP)
            np.testing.assert_allclose(jacobian[:, i], moved, atol=1e-8)


@pytest.mark.gradient
def test_the_stiffness_of_a_load_is_the_slope_of_its_torque(arm, poses):
    rng = np.random.default_rng(2)
    wrench = jnp.asarray(rng.normal(size=6))
    of_wrench = eqx.filter_jit(arm.load_stiffness)
    jacobian = eqx.filter_jit(arm.jacobian)
    for q in poses[:4]:
        for load, is_force in ((wrench, False), (wrench * jnp.array([1, 1, 1, 0, 0, 0]), True)):
            found = np.asarray(of_wrench(q, load))
            for i, change in enumerate(STEP * np.eye(JOINTS)):
                slope = (jacobian(q + change).T @ load - jacobian(q - change).T @ load) / (2.0 * STEP)
                np.testing.assert_allclose(found[:, i], -slope, atol=1e-8)
            # The second derivative of −F·x for a force; a moment has no potential.
            assert (np.abs(found - found.T).max() < 1e-12) == is_force


def test_rotations_count_at_a_distance():
    jacobian = jnp.ones((6, 2))
    np.testing.assert_array_equal(scaled_rows(jacobian, 0.3), np.repeat([[1.0], [0.3]], 3, 0) * np.ones((6, 2)))


@pytest.mark.analytic
def test_a_turn_about_an_axis_is_that_of_scipy():
    rng = np.random.default_rng(3)
    axes, angles = rng.normal(size=(9, 3)), rng.uniform(-7.0, 7.0, 9)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    expected = Rotation.from_rotvec(axes * angles[:, None]).as_matrix()
    np.testing.assert_allclose(rotation_about(jnp.asarray(axes), jnp.asarray(angles)), expected, atol=1e-15)


@pytest.mark.failure
def test_parts_that_do_not_belong_together_are_refused():
    with pytest.raises(ValueError, match="one offset, rotation and axis a joint"):
        SerialArm(np.zeros((2, 3)), np.zeros((3, 3, 3)), np.zeros((2, 3)), np.zeros(3))
    with pytest.raises(ValueError, match="at least one joint"):
        SerialArm(np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros(3))
