import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.vsajax.builders import PITCH
from tests.vsajax.plants.laws import SETPOINTS, SPRINGS
from vsajax import plants

# Every law is a handful of operations on numbers of one size: roundings add up to a few ε of the largest.
RELATIVE = 1e-13
DEFLECTIONS = jnp.linspace(-0.5, 0.5, 41)

each_law = pytest.mark.parametrize(
    ("law", "setpoints"), [(law, SETPOINTS[name]) for name, law in SPRINGS.items()], ids=SPRINGS.keys()
)


def over_grid(function, setpoints=SETPOINTS["lever"]):
    """Evaluate a law over every set-point and deflection."""
    return jax.vmap(lambda s: jax.vmap(lambda d: function(s, d))(DEFLECTIONS))(setpoints)


def assert_close(ours, expected):
    np.testing.assert_allclose(ours, expected, rtol=0.0, atol=RELATIVE * np.max(np.abs(expected)))


@pytest.mark.contract
def test_registry_holds_every_law():
    classes = {cls for _, cls in inspect.getmembers(plants, inspect.isclass)}
    laws = {cls for cls in classes if issubclass(cls, plants.AbstractSpring)}
    assert {type(law) for law in SPRINGS.values()} == laws - {plants.AbstractSpring}


@pytest.mark.contract
@each_law
def test_stiffness_is_the_slope_of_torque(law, setpoints):
    assert_close(over_grid(law.stiffness, setpoints), over_grid(jax.grad(law.torque, argnums=1), setpoints))


@pytest.mark.contract
@each_law
def test_coupling_is_the_slope_of_potential_energy(law, setpoints):
    # Gauss–Legendre with 40 nodes integrates these laws over ±0.5 rad to rounding.
    nodes, weights = np.polynomial.legendre.leggauss(40)

    def energy(setpoint, deflection):
        torques = jax.vmap(lambda x: law.torque(setpoint, 0.5 * deflection * (1.0 + x)))(jnp.asarray(nodes))
        return 0.5 * deflection * jnp.sum(jnp.asarray(weights) * torques)

    expected = over_grid(jax.grad(energy, argnums=0), setpoints)
    np.testing.assert_allclose(over_grid(law.coupling, setpoints), expected, rtol=1e-12, atol=1e-15)


@pytest.mark.contract
@each_law
def test_undeflected_law_is_torque_free_with_finite_stiffness_and_slopes(law, setpoints):
    setpoint, zero = setpoints[0], jnp.asarray(0.0)
    assert law.torque(setpoint, zero) == 0.0
    assert law.stiffness(setpoint, zero) > 0.0
    for derivative in (jax.jacfwd, jax.jacrev):
        slopes = derivative(lambda s, d: (law.torque(s, d), law.stiffness(s, d), law.coupling(s, d)), (0, 1))
        assert np.all(np.isfinite(jax.tree.leaves(slopes(setpoint, zero))))


@pytest.mark.contract
@pytest.mark.parametrize("name", [name for name in SPRINGS if name not in ("progressive", "regressive")])
def test_symmetric_law_is_odd(name):
    law, setpoints = SPRINGS[name], SETPOINTS[name]
    assert_close(over_grid(lambda s, d: law.torque(s, -d), setpoints), -over_grid(law.torque, setpoints))
    assert_close(over_grid(lambda s, d: law.stiffness(s, -d), setpoints), over_grid(law.stiffness, setpoints))


@pytest.mark.analytic
def test_sides_of_the_exponential_law_mirror_each_other():
    progressive, regressive = SPRINGS["progressive"], SPRINGS["regressive"]
    assert jnp.array_equal(over_grid(lambda s, d: progressive.torque(s, -d)), -over_grid(regressive.torque))
    assert_close(over_grid(progressive.torque), 0.4 * over_grid(lambda s, d: jnp.expm1(9.0 * d)))


@pytest.mark.analytic
def test_polynomial_law_with_two_terms_is_the_cubic_law():
    cubic, polynomial = plants.CubicSpring(20.0, 400.0), plants.PolynomialSpring([20.0, 400.0])
    assert_close(over_grid(polynomial.torque), over_grid(cubic.torque))
    assert_close(over_grid(polynomial.stiffness), over_grid(cubic.stiffness))


@pytest.mark.oracle
def test_lever_law_matches_the_corrected_printed_equations():
    law = SPRINGS["lever"]
    arm = 0.1 + PITCH * SETPOINTS["lever"][:, None]
    assert_close(over_grid(law.torque), 14220.0 * arm**2 * jnp.sin(2 * DEFLECTIONS))
    assert_close(over_grid(law.stiffness), 2 * 14220.0 * arm**2 * jnp.cos(2 * DEFLECTIONS))
    assert_close(over_grid(law.coupling), 2 * 14220.0 * PITCH * arm * jnp.sin(DEFLECTIONS) ** 2)


@pytest.mark.oracle
def test_lever_law_has_the_stiffness_of_the_reference(reference):
    law = SPRINGS["lever"]
    ours = law.stiffness(jnp.asarray(reference["theta_c"]), jnp.asarray(reference["q"] - reference["theta"]))
    np.testing.assert_allclose(ours, reference["sigma"], rtol=RELATIVE)
