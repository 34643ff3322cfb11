import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vsajax import numerics

pytestmark = pytest.mark.analytic

ULP = np.finfo(float).eps
# Sine and cosine in extended precision; where the platform has none, the reference is off by half an ulp itself.
REFERENCE_ERROR = np.finfo(np.longdouble).eps / 2


def angles() -> np.ndarray:
    rng = np.random.default_rng(0)
    spread = [rng.uniform(-limit, limit, 50_000) for limit in (1e-3, 4.0, 1e3, 1e6)]
    quarters = np.arange(-40, 41) * (np.pi / 2)
    return np.concatenate([*spread, quarters, np.nextafter(quarters, np.inf), [0.0, -0.0, 1e6, -1e6]])


@pytest.mark.parametrize("name", ["sin", "cos"])
def test_value_is_within_one_and_a_half_ulp_of_one(name):
    # The last sum and the reduced angle round once each, the polynomial a little; 1.11 ulp is the most in 3e7.
    x = angles()
    ours = np.asarray(getattr(numerics, name)(jnp.asarray(x)))
    exact = getattr(np, name)(x.astype(np.longdouble))
    assert np.max(np.abs(ours - exact)) <= 1.5 * ULP + REFERENCE_ERROR


@pytest.mark.parametrize(("name", "slope"), [("sin", np.cos), ("cos", lambda x: -np.sin(x))])
def test_derivative_is_that_of_the_function(name, slope):
    # The differentiated polynomial sums terms of total size cosh(π/2) = 2.5 with one rounding each way.
    x = angles()
    ours = jax.vmap(jax.grad(getattr(numerics, name)))(jnp.asarray(x))
    assert np.max(np.abs(np.asarray(ours) - slope(x))) <= 2 * 2.5 * ULP


def test_sine_of_a_small_angle_keeps_its_relative_precision():
    x = np.geomspace(1e-300, 1e-2, 500)
    np.testing.assert_allclose(numerics.sin(jnp.asarray(x)), np.sin(x), rtol=ULP, atol=0.0)


def test_sine_is_odd_and_cosine_even_exactly():
    x = jnp.asarray(angles())
    assert jnp.array_equal(numerics.sin(-x), -numerics.sin(x))
    np.testing.assert_allclose(numerics.cos(-x), numerics.cos(x), rtol=0.0, atol=ULP)
