"""From tables, Denavit–Hartenberg rows and URDF to an arm: against matrices, the reference, and yourdfpy."""

from __future__ import annotations

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import yourdfpy

from tuning.files.errors import InputError
from tuning.files.shipped import CONFIGS
from tuning.files.toml import read_toml, validate
from tuning.kinds.arm.robots import build_arm
from tuning.kinds.arm.tables import Arm
from tuning.papers.cartesian.self_motion import Lengths, scan

GOLDEN = Path(__file__).parents[2] / "golden"
PANDA = GOLDEN / "panda" / "panda.urdf"


def build(table: dict):
    return build_arm(validate(Arm, table, "study.toml"), "study.toml", Path("/"))


def about_x(angle, along):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0, along], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1.0]])


def about_z(angle, along):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, along], [0, 0, 0, 1.0]])


@pytest.mark.oracle
@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_denavit_hartenberg_rows_are_their_products(convention):
    rng = np.random.default_rng(0)
    a, alpha, d, theta, q = rng.uniform(-1.0, 1.0, (5, 4))
    rows = [
        {"a": float(a[i]), "alpha_deg": float(np.rad2deg(alpha[i])), "d": float(d[i])}
        | {"theta_deg": float(np.rad2deg(theta[i]))}
        for i in range(4)
    ]
    arm, _ = build({"dh": rows, "convention": convention, "tool": {"offset": [0.1, 0.2, 0.3]}})
    total = np.eye(4)
    for i in range(4):
        lean, turn = about_x(alpha[i], a[i]), about_z(q[i] + theta[i], d[i])
        total = total @ (turn @ lean if convention == "standard" else lean @ turn)
    hand = arm.forward(jnp.asarray(q))
    np.testing.assert_allclose(hand.position, total[:3, :3] @ [0.1, 0.2, 0.3] + total[:3, 3], atol=1e-14)
    np.testing.assert_allclose(hand.rotation, total[:3, :3], atol=1e-14)


@pytest.fixture(scope="module")
def panda():
    return build({"urdf": str(PANDA), "tip": "panda_hand_tcp"})


@pytest.mark.oracle
def test_a_urdf_of_others_stands_as_its_own_library_says(panda):
    arm, ranges = panda
    robot = yourdfpy.URDF.load(str(PANDA), load_meshes=False, build_collision_scene_graph=False)
    limits = [robot.joint_map[f"panda_joint{i}"].limit for i in range(1, 8)]
    np.testing.assert_array_equal(ranges, [[limit.lower, limit.upper] for limit in limits])
    poses = np.random.default_rng(0).uniform(*ranges.T, (10, 7))
    found = jax.vmap(arm.forward)(jnp.asarray(poses))
    for i, q in enumerate(poses):
        robot.update_cfg({f"panda_joint{k + 1}": q[k] for k in range(7)})
        expected = robot.get_transform("panda_hand_tcp", "panda_link0")
        np.testing.assert_allclose(found.position[i], expected[:3, 3], atol=1e-12)
        np.testing.assert_allclose(found.rotation[i], expected[:3, :3], atol=1e-12)


def test_a_chain_may_begin_above_the_root(panda):
    arm, ranges = build({"urdf": str(PANDA), "base": "panda_link2", "tip": "panda_link6"})
    np.testing.assert_array_equal(ranges, panda[1][2:6])
    assert arm.joints == 4


@pytest.mark.failure
@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"urdf": str(PANDA), "tip": "hand"}, ["study.toml: arm.tip: got 'hand'", "panda_hand_tcp"]),
        (
            {"urdf": str(PANDA), "tip": "panda_link4", "base": "panda_link7"},
            ["arm.base", "not above 'panda_link4'"],
        ),
        ({"urdf": str(PANDA), "tip": "panda_leftfinger"}, ["is prismatic", "allowed: revolute", "base and tip"]),
        ({"urdf": str(PANDA), "tip": "panda_link0"}, ["has no moving joint between"]),
        ({"urdf": "/nowhere.urdf", "tip": "hand"}, ["arm.urdf", "no such file", "paths start at"]),
        ({"urdf": str(PANDA.parent / "README.md"), "tip": "hand"}, ["is no URDF that can be read"]),
    ],
)
def test_a_mistake_about_a_urdf_is_named(table, said):
    with pytest.raises(InputError) as caught:
        build(table)
    for words in said:
        assert words in str(caught.value)


def preset(name: str):
    return build(read_toml(CONFIGS / "arms" / f"{name}.toml"))


@pytest.mark.oracle
def test_the_arm_of_four_joints_is_the_one_of_table_i():
    with np.load(GOLDEN / "cartesian.npz") as given:
        arm, _ = preset("hand-arm-4")
        q = jnp.deg2rad(jnp.asarray(given["t1_q_deg"]))
        np.testing.assert_allclose(arm.forward(q).position, given["t1_p"], atol=1e-12)
        np.testing.assert_allclose(arm.position_jacobian(q), given["t1_J"], atol=1e-12)


@pytest.mark.oracle
def test_the_arm_of_seven_joints_is_the_references():
    # The reference keeps Jacobians only; an axis in the frame of the two before it gives its joint's angle.
    with np.load(GOLDEN / "cartesian.npz") as given:
        jacobians = given["n7m6w_J"].copy()
    jacobians[:, 3:] /= 0.3
    arm, _ = preset("lwr-like-7")
    for jacobian in jacobians:
        axes = jacobian[3:].T
        q = [np.arctan2(-axes[1, 0], axes[1, 1])]
        for before, own, after in zip(axes, axes[1:], axes[2:], strict=False):
            q.append(np.arctan2(own @ np.cross(before, after), before @ after))
        # Joint 3 and 5 turn a tilted axis whose zero the conventions put apart by half a turn.
        found = min(
            (np.asarray(arm.jacobian(jnp.asarray([*turned, 0.0]))) for turned in half_turns(q)),
            key=lambda ours: np.abs(ours - jacobian).max(),
        )
        np.testing.assert_allclose(found, jacobian, atol=1e-12)
        assert 0.4 - 1e-9 < q[3] < 2.2 + 1e-9


def half_turns(q):
    for third in (0.0, np.pi):
        for fifth in (0.0, np.pi):
            yield [q[0], q[1], q[2] + third, q[3], q[4] + fifth, q[5]]


@pytest.mark.oracle
def test_the_scan_of_a_self_motion_is_made_of_the_arms_own_poses():
    arm, _ = preset("lwr-like-7")
    q = jnp.asarray([0.3, 0.7, -0.4, 1.1, 0.5, 0.8, 0.0])
    hand, own = np.asarray(arm.forward(q).position), np.asarray(arm.position_jacobian(q))
    scanned = scan(Lengths(0.34, 0.40, 0.39, 0.13), hand, np.deg2rad(120.0), 3000, 120)
    # Up to the sign of an axis, which no compliance sees, the arm's pose is in the grid.
    apart = np.minimum(np.abs(scanned - own), np.abs(scanned + own)).max((1, 2))
    squares = np.abs(scanned @ np.swapaxes(scanned, 1, 2) - own @ own.T).max((1, 2))
    assert apart.min() < 0.03
    assert squares[apart.argmin()] < 0.02
    assert apart.max() > 0.3
