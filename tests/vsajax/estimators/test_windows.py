"""Moving-window filters: exactness of the product rule, differentiability, and fast convolution."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vsajax.estimators import windows

SAMPLE_TIME = 1e-3
KERNELS = {"first": windows.FIRST, "second": windows.SECOND, "third": windows.THIRD}


def response(kernel: tuple[float, ...], window: float, taps: int, quadrature: str = "product") -> np.ndarray:
    return np.asarray(
        windows.impulse_response(
            kernel, jnp.asarray(window), sample_time=SAMPLE_TIME, taps=taps, quadrature=quadrature
        )
    )


def test_kernels_are_the_derivatives_of_u3_1_minus_u_3_over_6():
    g = np.polynomial.Polynomial([0, 0, 0, 1]) * np.polynomial.Polynomial([1, -1]) ** 3 / 6
    for order, kernel in enumerate(KERNELS.values(), 1):
        np.testing.assert_allclose(g.deriv(order).coef, kernel, atol=1e-14)
    square = np.polynomial.Polynomial(windows.FIRST) ** 2
    assert square.integ()(1.0) == pytest.approx(windows.FIRST_NORM**2, rel=1e-12)


@pytest.mark.analytic
@pytest.mark.parametrize("kernel", KERNELS.values(), ids=KERNELS)
@pytest.mark.parametrize("window", [0.1, 0.0973, 0.05])
def test_product_rule_is_exact_for_a_ramp(kernel, window):
    # The interpolant of a ramp is the ramp: ∫ K(u) (c + s T (u − 1)) du has a closed form for any real T.
    taps = windows.taps_of(0.1, SAMPLE_TIME)
    samples = 2.0 - 3.0 * SAMPLE_TIME * np.arange(taps)
    integral = np.polynomial.Polynomial(kernel) * np.polynomial.Polynomial([2.0 - 3.0 * window, 3.0 * window])
    exact = integral.integ()(1.0)
    assert response(kernel, window, taps) @ samples == pytest.approx(exact, abs=1e-14)


@pytest.mark.order
@pytest.mark.parametrize(("quadrature", "order"), [("trapezoid", 2), ("product", 2), ("simpson", 4)])
def test_rules_converge_at_their_order(quadrature, order):
    # The second kernel against a cosine: its ends vanish only simply, so no rule is superconvergent by symmetry.
    window, fine = 0.4, 20000
    u = (np.arange(fine) + 0.5) / fine
    y = lambda time: np.cos(7.0 * time)  # noqa: E731
    exact = np.mean(np.polynomial.polynomial.polyval(u, windows.SECOND) * y(window * (u - 1.0)))
    steps, errors = (20, 40, 80), []
    for n in steps:
        filter_taps = windows.impulse_response(
            windows.SECOND, jnp.asarray(window), sample_time=window / n, taps=n + 1, quadrature=quadrature
        )
        errors.append(abs(np.asarray(filter_taps) @ y(-window * np.arange(n + 1) / n) - exact))
    slope = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert slope == pytest.approx(order, abs=0.3)


@pytest.mark.gradient
def test_product_rule_is_differentiable_in_a_real_window():
    signal = jnp.asarray(np.random.default_rng(0).standard_normal(121))

    def value(window: jax.Array) -> jax.Array:
        taps = windows.impulse_response(
            windows.FIRST, window, sample_time=SAMPLE_TIME, taps=121, quadrature="product"
        )
        return taps @ signal

    at = jnp.asarray(0.0873)
    # The step stays within one sample cell, in which the taps are smooth.
    difference = (value(at + 1e-6) - value(at - 1e-6)) / 2e-6
    assert jax.grad(value)(at) == pytest.approx(float(difference), rel=1e-7)


@pytest.mark.oracle
def test_fast_convolution_is_the_direct_sum():
    rng = np.random.default_rng(1)
    taps, signals = rng.standard_normal(101), rng.standard_normal((500, 3))
    direct = np.stack([np.convolve(signals[:, i], taps)[:500] for i in range(3)], axis=1)
    np.testing.assert_allclose(windows.convolve(jnp.asarray(taps), jnp.asarray(signals)), direct, atol=1e-12)


@pytest.mark.failure
def test_simpson_needs_an_even_number_of_steps():
    with pytest.raises(ValueError, match="even number of steps in the window; got 5"):
        response(windows.FIRST, 0.005, 6, "simpson")
