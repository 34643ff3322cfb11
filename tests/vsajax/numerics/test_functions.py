import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import expit

from vsajax import numerics

pytestmark = pytest.mark.analytic

EPS = np.finfo(float).eps
STEP = 2.0**-10  # a power of two: λ = x / h and λ h = x are exact


def exact_response(x: np.ndarray, step: float) -> tuple[np.ndarray, ...]:
    """e^-x, (1 − e^-x)/x and (x − 1 + e^-x)/x² in extended precision, by series where they cancel."""
    x = x.astype(np.longdouble)
    terms = np.arange(40)
    factorials = np.array([math.factorial(int(i) + 2) for i in terms], np.longdouble)
    small = np.minimum(x, 1)[:, None]
    first = np.sum((-small) ** terms / (factorials / (terms + 2)), axis=1)
    second = np.sum((-small) ** terms / factorials, axis=1)
    safe = np.maximum(x, 1)
    first = np.where(x < 1, first, -np.expm1(-safe) / safe)
    second = np.where(x < 1, second, (safe + np.expm1(-safe)) / safe**2)
    return np.exp(-x), step * first, step**2 * second


def test_damped_response_is_exact_from_undamped_to_overdamped():
    x = np.concatenate([[0.0], np.geomspace(1e-12, 1e3, 4000)])
    ours = numerics.damped_response(jnp.asarray(x / STEP), jnp.asarray(STEP))
    decay, gain, travel = exact_response(x, STEP)
    np.testing.assert_allclose(ours[0], decay, rtol=4 * EPS, atol=np.finfo(float).tiny)
    np.testing.assert_allclose(ours[1], gain, rtol=4 * EPS)
    # x + expm1(−x) ≈ x²/2 loses 2/x of its digits; the worst is 1e-2, where the series takes over.
    np.testing.assert_allclose(ours[2], travel, rtol=4 * EPS / 1e-2)


def test_damped_response_is_continuous_where_the_series_takes_over():
    switch = 1e-2 / STEP
    below, above = (
        numerics.damped_response(jnp.asarray(np.nextafter(switch, way)), jnp.asarray(STEP)) for way in (0, np.inf)
    )
    for left, right, relative in zip(below, above, (4 * EPS, 4 * EPS, 4 * EPS / 1e-2), strict=True):
        np.testing.assert_allclose(left, right, rtol=relative)


@pytest.mark.gradient
@pytest.mark.parametrize("derivative", [jax.jacfwd, jax.jacrev])
def test_damped_response_has_the_right_slope_without_damping(derivative):
    # d/dλ of e^(−λh), (1 − e^(−λh))/λ and (h − g)/λ at λ = 0.
    slopes = derivative(numerics.damped_response)(jnp.asarray(0.0), jnp.asarray(STEP))
    np.testing.assert_allclose(slopes, [-STEP, -(STEP**2) / 2, -(STEP**3) / 6], rtol=4 * EPS)


@pytest.mark.gradient
def test_damped_response_slope_is_continuous_where_the_series_takes_over():
    switch = 1e-2 / STEP
    slope = jax.jacfwd(numerics.damped_response)
    below, above = (slope(jnp.asarray(np.nextafter(switch, way)), jnp.asarray(STEP)) for way in (0, np.inf))
    # The travel's slope ≈ 1/6 is a difference of terms of size 1/x² that each carry the error of expm1, x·ε.
    np.testing.assert_allclose(below, above, rtol=12 * EPS / 1e-2**2)


def test_damped_responses_of_two_half_steps_compose():
    rate = jnp.asarray([0.0, 1.0, 43.5, 1e3, 1.09e5])
    decay, gain, travel = numerics.damped_response(rate, jnp.asarray(2 * STEP))
    half_decay, half_gain, half_travel = numerics.damped_response(rate, jnp.asarray(STEP))
    np.testing.assert_allclose(decay, half_decay**2, rtol=1e-13, atol=1e-300)
    np.testing.assert_allclose(gain, half_gain * (1 + half_decay), rtol=1e-13)
    np.testing.assert_allclose(travel, 2 * half_travel + half_gain**2, rtol=1e-13)


def test_logistic_falls_from_one_to_zero_without_overflow():
    x = np.concatenate([np.linspace(-40, 40, 801), [-1e4, 1e4, -1e300, 1e300]])
    np.testing.assert_allclose(numerics.logistic(jnp.asarray(x)), expit(-x), rtol=0.0, atol=2 * EPS)


@pytest.mark.gradient
def test_logistic_slope_is_finite_everywhere():
    x = np.array([-1e300, -1e3, -1.0, 0.0, 1.0, 1e3, 1e300])
    slopes = jax.vmap(jax.grad(numerics.logistic))(jnp.asarray(x))
    np.testing.assert_allclose(slopes, -expit(x) * expit(-x), rtol=0.0, atol=2 * EPS)


def test_safe_divide_divides_and_is_flat_zero_at_a_zero_denominator():
    assert numerics.safe_divide(jnp.asarray(3.0), jnp.asarray(-2.0)) == -1.5
    assert numerics.safe_divide(jnp.asarray(3.0), jnp.asarray(0.0)) == 0.0
    for derivative in (jax.jacfwd, jax.jacrev):
        slopes = derivative(numerics.safe_divide, argnums=(0, 1))
        assert slopes(jnp.asarray(3.0), jnp.asarray(0.0)) == (0.0, 0.0)
        np.testing.assert_allclose(slopes(jnp.asarray(3.0), jnp.asarray(-2.0)), [-0.5, -0.75], rtol=4 * EPS)


def test_smooth_sign_is_odd_and_saturates():
    assert numerics.smooth_sign(jnp.asarray(0.0), jnp.asarray(0.05)) == 0.0
    saturated = numerics.smooth_sign(jnp.asarray([-1.0, 1.0]), jnp.asarray(0.05))
    np.testing.assert_allclose(saturated, [-1.0, 1.0], rtol=EPS)
    velocity = jnp.linspace(-0.2, 0.2, 41)
    ours = numerics.smooth_sign(velocity, jnp.asarray(0.05))
    np.testing.assert_allclose(ours, np.tanh(np.asarray(velocity) / 0.05), rtol=8 * EPS, atol=EPS)


def test_safe_sqrt_is_the_root_with_finite_derivatives():
    x = jnp.array([-1.0, 0.0, 1e-300, 0.25, 9.0])
    np.testing.assert_allclose(numerics.safe_sqrt(x), [0.0, 0.0, 1e-150, 0.5, 3.0], rtol=4 * EPS)
    slopes = jax.vmap(jax.grad(numerics.safe_sqrt))(x)
    np.testing.assert_allclose(slopes, [0.0, 0.0, 5e149, 1.0, 1.0 / 6.0], rtol=4 * EPS)


TWICE = [jax.hessian, lambda f: jax.jacfwd(jax.jacfwd(f)), lambda f: jax.grad(jax.grad(f))]


@pytest.mark.failure
@pytest.mark.parametrize("twice", TWICE, ids=["hessian", "forward", "reverse"])
def test_a_known_slope_has_first_derivatives_only(twice):
    def function(x):
        return numerics.with_slope(jax.lax.stop_gradient(x**3), 3.0 * x**2, x)

    at = jnp.asarray(2.0)
    assert [float(derive(function)(at)) for derive in (jax.grad, jax.jacfwd)] == [12.0, 12.0]
    with pytest.raises(TypeError, match="take first derivatives only"):
        twice(function)(at)
