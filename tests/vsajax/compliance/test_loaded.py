"""A design that knows the load on the hand, against direct linear algebra and the unloaded design."""

from __future__ import annotations

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vsajax.compliance import Status, StiffnessBounds, StiffnessDesigner, design_loaded, loaded_compliance

GOLDEN = Path(__file__).parents[2] / "golden" / "cartesian.npz"


@pytest.fixture(scope="module")
def t1():
    with np.load(GOLDEN) as given:
        names = ("t1_J", "t1_Kd", "t1_kmin", "t1_kmax")
        jacobian, stiffness, lower, upper = (jnp.asarray(given[name]) for name in names)
    return jacobian, stiffness, StiffnessBounds(lower, upper)


RUN = jax.jit(lambda j, k, b, h: design_loaded(StiffnessDesigner(), j, k, b, h))
PLAIN = jax.jit(lambda j, k, b: StiffnessDesigner().design(j, k, b))


@pytest.mark.slow(twin="test_two_joints_bear_a_load_that_the_design_knows")
@pytest.mark.analytic
def test_the_hand_has_the_desired_stiffness_under_the_load(t1):
    jacobian, stiffness, _ = t1
    root = np.random.default_rng(0).normal(size=(4, 4))
    load = jnp.asarray(4.0 * (root + root.T))
    design = RUN(*t1, load)
    assert design.status == Status.SOLVED
    assert design.is_exact
    # What the joints give, by NumPy: the load adds to their stiffness.
    joints = np.linalg.inv(np.diag(1.0 / np.asarray(design.joint_compliance)) + np.asarray(load))
    passive = np.asarray(jacobian) @ joints @ np.asarray(jacobian).T
    np.testing.assert_allclose(design.passive, passive, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(np.linalg.inv(passive + np.asarray(design.active)), stiffness, atol=1e-9)
    # A design that does not know it misses by much more than rounding.
    plain = PLAIN(*t1)
    blind = loaded_compliance(jacobian, plain.joint_compliance, load) + plain.active
    assert np.abs(np.linalg.inv(blind) - np.asarray(stiffness)).max() > 1.0
    without = RUN(*t1, jnp.zeros((4, 4)))
    np.testing.assert_allclose(without.joint_compliance, plain.joint_compliance, rtol=1e-12)


@pytest.mark.slow(twin="test_two_joints_bear_a_load_that_the_design_knows")
@pytest.mark.failure
def test_a_load_under_which_the_joints_give_way_says_so(t1):
    jacobian, stiffness, bounds = t1
    found = RUN(*t1, -600.0 * jnp.eye(4))
    assert found.status == Status.UNSTABLE
    assert "give way" in Status.UNSTABLE.text
    assert np.isnan(found.joint_stiffness).all()
    assert np.isnan(found.serial_stiffness).all()
    assert not found.is_exact
    assert np.isnan(loaded_compliance(jacobian, jnp.full(4, 0.01), -200.0 * jnp.eye(4))).all()
    # A bad input keeps its own status.
    assert RUN(jacobian, -stiffness, bounds, jnp.zeros((4, 4))).status == Status.NOT_DEFINITE


@pytest.mark.analytic
def test_two_joints_bear_a_load_that_the_design_knows():
    # An elbow in a plane, whose stiffness under the load NumPy gives.
    jacobian = jnp.array([[-0.3, -0.2], [0.4, 0.1]])
    stiffness, bounds = jnp.diag(jnp.array([150.0, 200.0])), StiffnessBounds(jnp.full(2, 5.0), jnp.full(2, 500.0))
    load = jnp.array([[3.0, 1.0], [1.0, -2.0]])
    design = RUN(jacobian, stiffness, bounds, load)
    assert (design.status, bool(design.is_exact)) == (Status.SOLVED, True)
    joints = np.linalg.inv(np.diag(1.0 / np.asarray(design.joint_compliance)) + np.asarray(load))
    passive = np.asarray(jacobian) @ joints @ np.asarray(jacobian).T
    np.testing.assert_allclose(design.passive, passive, rtol=1e-9)
    np.testing.assert_allclose(np.linalg.inv(passive + np.asarray(design.active)), stiffness, rtol=1e-9)
    assert np.abs(loaded_compliance(jacobian, design.joint_compliance, jnp.zeros((2, 2))) - passive).max() > 1e-6
    assert RUN(jacobian, stiffness, bounds, -600.0 * jnp.eye(2)).status == Status.UNSTABLE
