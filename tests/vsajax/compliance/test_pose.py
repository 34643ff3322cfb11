"""The search of poses on an arm whose self-motion is known: a planar arm of three joints."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vsajax.arms import SerialArm
from vsajax.compliance import improve_pose, reach

LENGTHS = np.array([0.4, 0.3, 0.2])
RANGES = jnp.tile(jnp.array([-3.0, 3.0]), (3, 1))


@pytest.fixture(scope="module")
def arm():
    offsets = np.array([[0.0] * 3, [0.4, 0.0, 0.0], [0.3, 0.0, 0.0]])
    return SerialArm(
        offsets, np.tile(np.eye(3), (3, 1, 1)), np.tile([0.0, 0.0, 1.0], (3, 1)), np.array([0.2, 0.0, 0.0])
    )


def objective(q):
    return (jnp.sin(q - jnp.array([0.2, 0.9, 0.4])) ** 2).sum()


def self_motion(hand: np.ndarray, count: int) -> np.ndarray:
    """Return all poses with the hand at a place: the direction of the last link, two elbows each."""
    angle = np.linspace(-np.pi, np.pi, count)
    wrist = hand[:2] - LENGTHS[2] * np.stack([np.cos(angle), np.sin(angle)], 1)
    square = (wrist**2).sum(1)
    cosine = (square - LENGTHS[0] ** 2 - LENGTHS[1] ** 2) / (2.0 * LENGTHS[0] * LENGTHS[1])
    angle, wrist, cosine = angle[np.abs(cosine) < 1], wrist[np.abs(cosine) < 1], cosine[np.abs(cosine) < 1]
    found = []
    for second in (np.arccos(cosine), -np.arccos(cosine)):
        first = np.arctan2(wrist[:, 1], wrist[:, 0]) - np.arctan2(
            LENGTHS[1] * np.sin(second), LENGTHS[0] + LENGTHS[1] * np.cos(second)
        )
        found.append(np.stack([first, second, angle - first - second], 1))
    turned = np.concatenate(found)
    return (turned + np.pi) % (2.0 * np.pi) - np.pi


@pytest.fixture(scope="module")
def search(arm):
    @jax.jit
    def run(starts, hands):
        def one(start, hand):
            placed, shift = reach(arm, start, hand, RANGES)
            return shift, objective(placed), improve_pose(objective, arm, placed, hand, RANGES, steps=60)

        return jax.vmap(one)(starts, hands)

    return run


@pytest.mark.slow(
    twin="tests/tuning/cli/test_arms.py::test_a_small_arm_of_a_urdf_goes_through_every_command_under_its_joints_names"
)
@pytest.mark.oracle
def test_searches_find_the_best_of_the_self_motion_and_hold_the_hand(search):
    rng = np.random.default_rng(0)
    hand = np.array([0.45, 0.3, 0.0])
    starts = jnp.asarray(rng.uniform(-3.0, 3.0, (17, 3)))
    # The last target is out of reach.
    shift, before, found = search(starts, jnp.asarray(np.vstack([np.tile(hand, (16, 1)), [2.0, 0.0, 0.0]])))
    placed = np.asarray(shift) < 1e-9
    assert placed.sum() > 12
    np.testing.assert_allclose(found.initial[placed], before[placed], rtol=1e-6)
    assert (np.asarray(found.value) <= np.asarray(found.initial))[placed].all()
    assert np.asarray(found.shift)[placed].max() < 1e-9
    poses = self_motion(hand, 20_001)
    inside = poses[(np.abs(poses) < 3.0).all(1)]
    least = float(jax.vmap(objective)(jnp.asarray(inside)).min())
    best = float(np.asarray(found.value)[placed].min())
    assert best == pytest.approx(least, abs=1e-4)
    assert float(np.median(np.asarray(found.initial)[placed])) > least + 0.1

    assert float(shift[-1]) > 1.0
    assert np.isinf(found.value[-1])
    assert float(found.shift[-1]) > 1.0
