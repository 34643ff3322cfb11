"""The arm under its controller: the stiffness read back, the reference's force sweeps, energy."""

from __future__ import annotations

from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vsajax.arms import ArmBodies, SerialArm
from vsajax.compliance import CartesianImpedance
from vsajax.experiments import arm as arm_loop
from vsajax.plants import CompliantArm, PresetSpring

GOLDEN = Path(__file__).parents[2] / "golden"


@pytest.fixture(scope="module")
def t1():
    with np.load(GOLDEN / "cartesian.npz") as archive:
        return {name: archive[name] for name in archive.files if name.startswith("t1_")}


@pytest.fixture(scope="module")
def sweeps():
    with np.load(GOLDEN / "cartesian_closedloop.npz") as archive:
        return {name: archive[name] for name in archive.files}


@pytest.fixture(scope="module")
def arm(t1):
    """The reference's geometry: a shoulder of three axes that meet, an elbow."""
    upper, lower = t1["t1_L"]
    turns = np.stack([t1["t1_B"], np.eye(3), np.eye(3), np.eye(3)])
    axes = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    offsets = np.array([[0.0] * 3, [0.0] * 3, [0.0] * 3, [upper, 0.0, 0.0]])
    return SerialArm(offsets, turns, axes, np.array([lower, 0.0, 0.0]))


@pytest.fixture(scope="module")
def posture(t1):
    return jnp.deg2rad(jnp.asarray(t1["t1_q_deg"]))


def loop_of(arm, t1, posture, sweeps, *, gravity: bool, view, posture_stiffness=20.0):
    if gravity:
        upper, lower = t1["t1_L"]
        masses = np.array([0.0, 0.0, sweeps["mu"], sweeps["mf"]])
        centres = np.array([[0.0] * 3, [0.0] * 3, [0.5 * upper, 0.0, 0.0], [0.7 * lower, 0.0, 0.0]])
        bodies = ArmBodies(masses, centres, np.zeros((4, 3, 3)), np.array([9.81, 0.0, 0.0]))
    else:
        bodies = ArmBodies(np.zeros(4), np.zeros((4, 3)), np.zeros((4, 3, 3)))
    spring = PresetSpring(sweeps["phis"])
    setpoints = spring.preset(jnp.asarray(t1["t1_k"]), bodies.load(arm, posture))
    controller = CartesianImpedance(arm, t1["t1_Ka"], posture, posture_stiffness)
    return arm_loop.ArmLoop.at(CompliantArm(arm, bodies, spring, setpoints), controller, posture, view=view)


RUN = eqx.filter_jit(arm_loop.equilibria)


@eqx.filter_jit
def slopes_at_rest(loop, posture):
    """Return what is not balanced at rest, its slope by all positions, and the hand's Jacobian."""
    at_rest = loop.rest(posture)

    def unbalanced(positions):
        return loop.unbalanced(positions, jnp.zeros(3), at_rest)

    positions = jnp.concatenate([at_rest.link_position, at_rest.motor_position])
    return unbalanced(positions), jax.jacfwd(unbalanced)(positions), loop.plant.arm.position_jacobian(posture)


@pytest.mark.analytic
@pytest.mark.parametrize(("view", "gravity"), [("motor", False), ("shifted", True)])
def test_a_hand_at_rest_has_the_stiffness_of_the_reference(view, gravity, arm, t1, posture, sweeps):
    loop = loop_of(arm, t1, posture, sweeps, gravity=gravity, view=view)
    error, slope, jacobian = map(np.asarray, slopes_at_rest(loop, posture))
    assert np.abs(error).max() < 1e-9
    # A force enters by the links' Jᵀ F alone.
    moved = np.linalg.solve(slope, -np.concatenate([jacobian.T, np.zeros_like(jacobian.T)]))[:4]
    expected = sweeps["grav_shift_K0"] if gravity else t1["t1_Ks"]
    np.testing.assert_allclose(np.linalg.inv(jacobian @ moved), expected, atol=1e-3)


@pytest.mark.slow(twin="test_a_hand_at_rest_has_the_stiffness_of_the_reference")
@pytest.mark.analytic
def test_the_hand_has_the_stiffness_that_was_designed(arm, t1, posture, sweeps):
    # Read back as dF/dx from the closed loop of motors, springs and controller, then along the reference's sweep;
    # the last force is too far from the one before for Newton, which must say so.
    forces = jnp.zeros((22, 3)).at[:, 2].set(jnp.append(jnp.linspace(0.0, 20.0, 21), -1e4))
    loop = loop_of(arm, t1, posture, sweeps, gravity=False, view="motor")
    found = RUN(loop, posture, forces)
    assert float(found.residual[:21].max()) < 1e-9
    np.testing.assert_allclose(found.stiffness[0], t1["t1_Ks"], atol=1e-8)
    np.testing.assert_allclose(found.predicted[0], t1["t1_Ks"], atol=1e-8)
    for name, ours in (("dx", found.hand), ("dmot", found.motor_hand), ("k", found.joint_stiffness)):
        np.testing.assert_allclose(ours[:21:10], sweeps[f"nograv_prog_z_{name}"], rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(found.stiffness[:21:10], sweeps["nograv_prog_z_Ktan"], rtol=1e-5, atol=1e-3)
    assert not float(found.residual[21]) < 1e-6
    assert np.isnan(found.stiffness[21]).all()


@pytest.mark.slow(twin="test_a_hand_at_rest_has_the_stiffness_of_the_reference")
@pytest.mark.oracle
@pytest.mark.parametrize(
    ("view", "name"),
    [
        ("quasi_static", "grav_qbar_qbar_link_K0"),
        ("shifted", "grav_shift_K0"),
        ("motor", "grav_const_theta_K0"),
    ],
)
def test_under_gravity_the_view_of_the_controller_decides(view, name, arm, t1, posture, sweeps):
    loop = loop_of(arm, t1, posture, sweeps, gravity=True, view=view)
    np.testing.assert_allclose(loop.plant.setpoints, sweeps["K0"], rtol=1e-9)
    found = RUN(loop, posture, jnp.zeros((6, 3)))
    np.testing.assert_allclose(found.joint_stiffness[0], t1["t1_k"], rtol=1e-9)
    np.testing.assert_allclose(found.stiffness[0], sweeps[name], atol=1e-3)


def energy(loop, motion):
    """Return the energy of links, motors, springs and of the controller's stiffness [J]."""
    link, motor, link_rate, motor_rate = motion
    plant, control = loop.plant, loop.controller
    spring = (
        plant.setpoints * plant.spring.progression**2 * (jnp.cosh((motor - link) / plant.spring.progression) - 1)
    )
    offset = plant.arm.forward(motor).position - plant.arm.forward(control.posture).position
    kinetic = link_rate @ plant.bodies.inertia(plant.arm, link) @ link_rate + plant.motor_inertia * (
        motor_rate @ motor_rate
    )
    return spring.sum() + 0.5 * (offset @ control.stiffness @ offset + kinetic)


@pytest.mark.slow(
    twin=(
        "test_the_damping_gives_every_mode_the_ratio_asked",
        "tests/vsajax/arms/test_bodies.py::test_the_torques_of_motion_are_those_of_christoffel",
    )
)
@pytest.mark.analytic
def test_the_loop_keeps_its_energy_without_damping_and_loses_it_with(arm, t1, posture, sweeps):
    # Pushed for 20 ms, then left alone. Without a posture stiffness, whose projection has no potential, the
    # undamped loop is conservative; with damping its energy only falls.
    rng = np.random.default_rng(0)
    root = rng.normal(size=(4, 3, 3))
    bodies = ArmBodies(np.ones(4), np.full((4, 3), 0.1), 0.01 * root @ np.swapaxes(root, 1, 2), np.zeros(3))
    bare = loop_of(arm, t1, posture, sweeps, gravity=False, view="motor", posture_stiffness=0.0)
    bare = eqx.tree_at(lambda whole: whole.plant.bodies, bare, bodies)
    bare = eqx.tree_at(lambda whole: whole.plant.spring_damping, bare, jnp.asarray(0.0))
    forces = jnp.where(jnp.arange(1000)[:, None] < 40, jnp.array([10.0, -5.0, 20.0]), 0.0)
    run = eqx.filter_jit(arm_loop.simulate)
    each = eqx.filter_jit(lambda loop, motion: eqx.filter_vmap(lambda m: energy(loop, m))(motion))
    motion, _ = run(bare, posture, forces, 5e-4)
    kept = np.asarray(each(bare, motion))[40:]
    assert kept[0] > 0.01
    np.testing.assert_allclose(kept, kept[0], rtol=1e-5)

    damped = eqx.tree_at(lambda whole: whole.controller, bare, bare.controller.damped(0.7, 0.5))
    damped = eqx.tree_at(lambda whole: whole.plant.spring_damping, damped, jnp.asarray(0.5))
    motion, hand = run(damped, posture, forces, 5e-4)
    left = np.asarray(each(damped, motion))[40:]
    assert np.diff(left).max() < 1e-9
    assert left[-1] < 0.3 * left[0]
    assert np.abs(hand[-1]).max() < np.abs(hand).max()


@pytest.mark.analytic
def test_the_damping_gives_every_mode_the_ratio_asked(arm, t1, posture):
    inertia, ratio = 0.5, 0.7
    control = CartesianImpedance(arm, t1["t1_Ka"], posture, 20.0).damped(ratio, inertia)
    jacobian = np.asarray(arm.position_jacobian(posture))
    mass = np.linalg.inv(jacobian @ jacobian.T / inertia)
    # ẍ + M⁻¹ D ẋ + M⁻¹ K x = 0: its poles lie where the ratio puts them.
    below = [-np.linalg.solve(mass, np.asarray(m)) for m in (control.stiffness, control.damping)]
    poles = np.linalg.eigvals(np.block([[np.zeros((3, 3)), np.eye(3)], below]))
    np.testing.assert_allclose(-poles.real / np.abs(poles), ratio, rtol=1e-9)
    np.testing.assert_allclose(control.posture_damping, 2.0 * ratio * np.sqrt(inertia * 20.0), rtol=1e-12)


@pytest.mark.analytic
def test_the_posture_stiffness_is_out_of_the_hands(arm, t1, posture):
    control = CartesianImpedance(arm, t1["t1_Ka"], posture, 20.0)
    jacobian = np.asarray(arm.position_jacobian(posture))
    moved = posture + 1e-6 * jnp.asarray([1.0, -2.0, 3.0, 0.5])
    torque = np.asarray(control.torque(moved, jnp.zeros(4)))
    stiff = -jacobian.T @ t1["t1_Ka"] @ jacobian @ np.asarray(moved - posture)
    seen = np.linalg.lstsq(jacobian.T, torque - stiff, rcond=None)[0]
    assert np.abs(jacobian @ (torque - stiff)).max() < 1e-4 * np.abs(torque - stiff).max()
    assert np.abs(seen).max() < 1e-4
    assert np.abs(torque - stiff).max() > 1e-6
