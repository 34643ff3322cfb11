import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial import legendre

from tests.oracles.basis import separable
from tests.vsajax.builders import PITCH, paper_basis
from tests.vsajax.estimators.parts import BASES
from vsajax import estimators
from vsajax.estimators import Legendre, Polynomial, SeparableOddPolynomial, Taylor

DEFLECTIONS = jnp.linspace(-0.2, 0.2, 21)
SETPOINT = jnp.asarray(-42.0)
# A feature of degree n is n products: n/2 ulp, here n ≤ 15.
RELATIVE = 1e-14

each_basis = pytest.mark.parametrize("basis", BASES.values(), ids=BASES.keys())


def evaluate(basis, setpoint=SETPOINT, deflections=DEFLECTIONS):
    """Return features and slopes, a row for every deflection."""
    features, slopes = jax.vmap(lambda d: basis(setpoint, d))(deflections)
    return np.asarray(features), np.asarray(slopes)


@pytest.mark.contract
def test_registry_holds_every_basis():
    classes = {cls for _, cls in inspect.getmembers(estimators, inspect.isclass)}
    bases = {cls for cls in classes if issubclass(cls, estimators.AbstractBasis)}
    assert {type(basis) for basis in BASES.values()} == bases - {estimators.AbstractBasis}


@pytest.mark.contract
@each_basis
def test_slopes_are_the_derivatives_of_the_features(basis):
    _, slopes = evaluate(basis)
    expected = jax.vmap(jax.jacfwd(lambda d: basis(SETPOINT, d)[0]))(DEFLECTIONS)
    np.testing.assert_allclose(slopes, expected, rtol=RELATIVE, atol=RELATIVE * np.max(np.abs(expected)))


@pytest.mark.contract
@each_basis
def test_size_counts_features_and_slopes(basis):
    features, slopes = evaluate(basis)
    assert features.shape == slopes.shape == (len(DEFLECTIONS), basis.size)


@pytest.mark.contract
@each_basis
def test_features_are_independent_functions(basis):
    # Two equal features would leave the prior to share one coefficient between them.
    setpoints = jnp.asarray([-60.0, -40.0, 0.0, 20.0])
    table = np.concatenate([evaluate(basis, s, jnp.linspace(-0.2, 0.2, 101))[0] for s in setpoints])
    assert np.linalg.matrix_rank(table / np.linalg.norm(table, axis=0), tol=1e-12) == basis.size


@pytest.mark.contract
@each_basis
def test_setpoint_matters_exactly_where_the_basis_says_so(basis):
    here, there = evaluate(basis, jnp.asarray(-42.0)), evaluate(basis, jnp.asarray(-41.0))
    assert np.array_equal(here, there) is not basis.uses_setpoint


@pytest.mark.oracle
def test_paper_basis_matches_numpy():
    features, slopes = evaluate(paper_basis())
    millimetres = np.full(len(DEFLECTIONS), 1000.0 * (0.1 + PITCH * -42.0))
    for ours, theirs in zip((features, slopes), separable(np.asarray(DEFLECTIONS), millimetres), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=RELATIVE, atol=0.0)


@pytest.mark.analytic
def test_deflection_scale_divides_the_deflection():
    features, slopes = evaluate(SeparableOddPolynomial(0.5, deflection_terms=3))
    x = np.asarray(DEFLECTIONS)
    np.testing.assert_allclose(features, np.stack([(x / 0.5) ** e for e in (1, 3, 5)], -1), rtol=RELATIVE)
    np.testing.assert_allclose(slopes, np.stack([e * x ** (e - 1) / 0.5**e for e in (1, 3, 5)], -1), rtol=RELATIVE)


@pytest.mark.analytic
def test_millimetres_scale_the_setpoint_alone():
    metres = SeparableOddPolynomial(1.0, 0.1, PITCH, deflection_terms=1, setpoint_terms=3, setpoint_unit="m")
    millimetres = paper_basis(1, 3)
    np.testing.assert_allclose(
        evaluate(millimetres)[0], evaluate(metres)[0] * np.array([1.0, 1e3, 1e6]), rtol=RELATIVE
    )


@pytest.mark.analytic
@pytest.mark.parametrize("offset", [0.0, 0.03, -0.11])
def test_offset_basis_spans_the_odd_powers_about_any_offset(offset):
    features, _ = evaluate(SeparableOddPolynomial(0.2, deflection_terms=3, deflection_offset=True))
    x = np.asarray(DEFLECTIONS) - offset
    shifted = np.stack([(x / 0.2) ** e for e in (1, 3, 5)], -1)
    coefficients = np.linalg.lstsq(features, shifted)[0]
    np.testing.assert_allclose(features @ coefficients, shifted, atol=1e-12)


@pytest.mark.analytic
def test_torque_bias_adds_the_constant_once():
    plain, biased = (SeparableOddPolynomial(deflection_terms=2, torque_bias=b) for b in (False, True))
    assert biased.size == plain.size + 1
    features, slopes = evaluate(biased)
    np.testing.assert_array_equal(features[:, -1], 1.0)
    np.testing.assert_array_equal(slopes[:, -1], 0.0)
    # The even powers of an offset start with the constant; a second one would be a copy.
    assert BASES["offset and bias"].size == 8


@pytest.mark.analytic
def test_polynomial_is_the_powers_of_the_scaled_deflection():
    features, _ = evaluate(Polynomial(0.2, order=5))
    expected = np.vander(np.asarray(DEFLECTIONS) / 0.2, 6, increasing=True)
    np.testing.assert_allclose(features, expected, rtol=RELATIVE)


@pytest.mark.analytic
def test_taylor_coefficients_are_those_of_the_stiffness():
    # σ = σ₀ + σ₁ x + σ₂ x²/2 + …, per radian of the scale: slopes are the Taylor monomials themselves.
    _, slopes = evaluate(Taylor(0.2, order=3))
    x = np.asarray(DEFLECTIONS) / 0.2
    expected = np.stack([np.ones_like(x), x, x**2 / 2, x**3 / 6], axis=-1) / 0.2
    np.testing.assert_allclose(slopes, expected, rtol=RELATIVE)


@pytest.mark.oracle
def test_legendre_matches_numpy_in_and_beyond_its_range():
    lower, upper, order = -0.12, 0.1, 7
    features, slopes = evaluate(Legendre(lower, upper, order=order))
    x = 2.0 * (np.asarray(DEFLECTIONS) - lower) / (upper - lower) - 1.0
    expected = legendre.legvander(x, order)
    derivative = np.stack([legendre.legval(x, legendre.legder(row)) for row in np.eye(order + 1)], axis=-1)
    # The recursions cancel values of the size of the largest.
    np.testing.assert_allclose(features, expected, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(slopes, derivative * 2.0 / (upper - lower), rtol=1e-13, atol=1e-12)


@pytest.mark.analytic
def test_legendre_polynomials_are_orthogonal_over_their_range():
    nodes, weights = legendre.leggauss(16)
    features, _ = evaluate(Legendre(-0.12, 0.1, order=7), deflections=jnp.asarray(-0.01 + 0.11 * nodes))
    gram = features.T @ (weights[:, None] * features)
    np.testing.assert_allclose(gram, np.diag(2.0 / (2.0 * np.arange(8) + 1.0)), atol=1e-14)
