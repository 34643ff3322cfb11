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
    taps, signals = rng.standard_normal((2, 101)), rng.standard_normal((2, 500))
    direct = sum(np.convolve(signal, tap)[:500] for tap, signal in zip(taps, signals, strict=True))
    both = windows.convolve(tuple(map(jnp.asarray, taps)), tuple(map(jnp.asarray, signals)))
    np.testing.assert_allclose(both, direct, atol=1e-12)


@pytest.mark.analytic
@pytest.mark.parametrize(
    ("quadrature", "window", "span"),
    [
        ("product", 0.0073, 0.0073),
        ("trapezoid", 0.0073, 0.007),
        ("simpson", 0.0073, 0.006),
        ("trapezoid", 0.3, 0.3),
    ],
)
def test_rules_on_whole_samples_cover_those_within_the_window(quadrature, window, span):
    assert windows.span_of(jnp.asarray(window), sample_time=1e-3, quadrature=quadrature) == pytest.approx(span)


@pytest.mark.equivalence
@pytest.mark.parametrize("quadrature", ["product", "trapezoid", "simpson"])
def test_taps_beyond_the_window_weigh_nothing(quadrature):
    exact, spare = (np.asarray(response(windows.SECOND, 0.02, taps, quadrature)) for taps in (21, 41))
    np.testing.assert_allclose(spare[:21], exact, rtol=1e-13)
    assert not spare[21:].any()


def test_transforms_have_lengths_that_are_fast_and_no_longer_than_need_be():
    def factors(number: int) -> set[int]:
        return {p for p in range(2, number + 1) if number % p == 0 and all(p % q for q in range(2, p))}

    for least in (2, 3, 7, 97, 640, 1025, 2187, 11001):
        length = windows._fast_length(least)
        assert length % 2 == 0
        assert factors(length) <= {2, 3, 5}
        assert not any(n % 2 == 0 and factors(n) <= {2, 3, 5} for n in range(least, length))
