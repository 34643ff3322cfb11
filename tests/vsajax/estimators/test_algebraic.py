"""The algebraic observer against a textbook twin, online against offline, and its invariances."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vsajax import Recording, Scorer
from vsajax.estimators import (
    AlgebraicObserver,
    AntagonisticPair,
    KinematicKalman,
    RecursiveLeastSquares,
    SeparableOddPolynomial,
    Taylor,
    windows,
)
from vsajax.experiments import estimation

INERTIA, DAMPING, SAMPLE_TIME, WINDOW = 1e-4, 1.27, 1e-3, 0.2


def observer(**options: object) -> AlgebraicObserver:
    settings = {"window": WINDOW, "longest_window": WINDOW, "basis": Taylor(order=2)} | options
    fit = settings.pop("fit", RecursiveLeastSquares(1e10))
    return AlgebraicObserver(INERTIA, DAMPING, fit=fit, sample_time=SAMPLE_TIME, **settings)


def consistent_recording(samples: int = 800, offset: float = 0.0) -> tuple[Recording, np.ndarray]:
    """Return a motion that obeys the motor equation with τ_e = 10 φ³ exactly, and its stiffness."""
    time = np.arange(samples) * SAMPLE_TIME
    wave, rate = np.sin(9.0 * time), 9.0
    position = offset + 0.3 * wave
    velocity, acceleration = 0.3 * rate * np.cos(rate * time), -0.3 * rate**2 * wave
    deflection = 0.6 + 0.25 * np.cos(5.0 * time) + 0.1 * np.sin(13.0 * time)
    torque = INERTIA * acceleration + DAMPING * velocity - 10.0 * deflection**3
    recording = Recording(
        *map(jnp.asarray, (time, position + deflection, position)), motor_torque=jnp.asarray(torque)
    )
    return recording, 30.0 * deflection**2


@pytest.mark.analytic
@pytest.mark.parametrize("start", ["window", "rest"])
def test_stiffness_of_a_consistent_motion_is_found(start):
    recording, stiffness = consistent_recording()
    answer = estimation.estimate(observer(fit=RecursiveLeastSquares(1e20), start=start), recording)
    if start == "window":
        # Measured 2e-9, 24 times more at twice the sample time: the identity's O(T_s⁴). At P(0) = 1e16 the prior
        # alone would cost 1.6e-5.
        np.testing.assert_allclose(answer.stiffness[-200:], stiffness[-200:], rtol=1e-8)
    else:
        # Held at the first value is not what this motion did before, and the fit never forgets it.
        assert np.max(np.abs(answer.stiffness[-200:] / stiffness[-200:] - 1.0)) > 1e-3


@pytest.mark.oracle
@pytest.mark.parametrize(("weighting", "weight"), [("sample", 1.0), ("continuous", SAMPLE_TIME)])
def test_fit_is_ridge_regression_on_convolved_signals(weighting, weight):
    recording, _ = consistent_recording()
    q, phi = np.asarray(recording.motor_position), np.asarray(recording.link_position - recording.motor_position)
    taps = {
        name: np.asarray(
            windows.impulse_response(
                kernel, jnp.asarray(WINDOW), sample_time=SAMPLE_TIME, taps=201, quadrature="product"
            )
        )
        for name, kernel in (("1", windows.FIRST), ("2", windows.SECOND), ("3", windows.THIRD))
    }
    fir = lambda c, y: np.convolve(y, c)[: len(y)]  # noqa: E731
    target = fir(WINDOW * DAMPING * taps["2"] - INERTIA * taps["3"], q)
    target += WINDOW**2 * fir(taps["1"], np.asarray(recording.motor_torque))
    rows = -(WINDOW**2) * np.stack(
        [fir(taps["1"], phi), fir(taps["1"], phi**2 / 2), fir(taps["1"], phi**3 / 6)], 1
    )
    rows, target = rows[200:] * np.sqrt(weight), target[200:] * np.sqrt(weight)
    prior = 1e8
    coefficients = np.linalg.solve(rows.T @ rows + np.eye(3) / prior, rows.T @ target)
    estimator = observer(fit=RecursiveLeastSquares(prior), weighting=weighting)
    answer = estimation.estimate(estimator, recording)
    slopes = np.array([1.0, phi[-1], phi[-1] ** 2 / 2])
    # 600 recursive steps at a condition number near 1e6.
    assert answer.stiffness[-1] == pytest.approx(slopes @ coefficients, rel=1e-9)


@pytest.mark.equivalence
@pytest.mark.parametrize("start", ["window", "zeros", "rest"])
@pytest.mark.parametrize("filtered", [False, True])
def test_online_is_offline(start, filtered):
    recording, _ = consistent_recording(420, offset=2.0)
    velocity = KinematicKalman(1e3, 1e-6) if filtered else None
    estimator = observer(fit=RecursiveLeastSquares(1e6), start=start, velocity=velocity)
    offline = estimation.estimate(estimator, recording)
    samples = recording.samples()
    first = jax.tree.map(lambda x: x[0], samples)
    online = estimation.rollout.scan(estimator.step, estimator.init(first), samples)[1]
    scale = float(jnp.max(jnp.abs(offline.stiffness)))
    # The convolution's rounding, 1e-16 of the signals, relative to C, which cancels to 1e-3 of them.
    np.testing.assert_allclose(online.stiffness, offline.stiffness, atol=1e-11 * scale)
    np.testing.assert_array_equal(online.known, offline.known)


@pytest.mark.equivalence
def test_continuous_weight_is_sample_weight_with_a_smaller_prior():
    recording, _ = consistent_recording(400)
    sampled = observer(fit=RecursiveLeastSquares(1e10 * SAMPLE_TIME))
    continuous = observer(fit=RecursiveLeastSquares(1e10), weighting="continuous")
    np.testing.assert_allclose(
        estimation.estimate(sampled, recording).stiffness,
        estimation.estimate(continuous, recording).stiffness,
        rtol=1e-9,
    )


@pytest.mark.analytic
def test_scale_free_prior_does_not_see_the_unit_of_the_basis():
    recording, _ = consistent_recording(400)
    # Features in another unit are other features; with the prior in torque units they carry its square per order.
    basis = SeparableOddPolynomial(deflection_scale=1.0, deflection_terms=1)
    other = SeparableOddPolynomial(deflection_scale=1e-3, deflection_terms=1)
    one = observer(basis=basis, fit=RecursiveLeastSquares(1e3), scaling="scale_free")
    two = observer(basis=other, fit=RecursiveLeastSquares(1e3 * 1e-6), scaling="scale_free")
    np.testing.assert_allclose(
        estimation.estimate(one, recording).stiffness, estimation.estimate(two, recording).stiffness, rtol=1e-9
    )


@pytest.mark.gradient
def test_error_is_differentiable_in_the_window():
    recording, stiffness = consistent_recording()
    base = observer(fit=RecursiveLeastSquares(1e8), longest_window=0.3, scaling="scale_free")

    def error(window: jax.Array) -> jax.Array:
        estimator = eqx.tree_at(lambda e: e.window, base, window)
        return estimation.score(
            estimator, recording, jnp.asarray(stiffness), scorer=Scorer(warm_up=0.4)
        ).msrep_settled

    at = jnp.asarray(0.15537)
    # Between two whole numbers of samples; at them the start of the fit jumps by a sample.
    difference = (error(at + 2e-6) - error(at - 2e-6)) / 4e-6
    assert jax.jacfwd(error)(at) == pytest.approx(float(difference), rel=1e-5)


def test_pair_adds_its_sides():
    recording, _ = consistent_recording()
    both = Recording(
        recording.time,
        recording.link_position,
        motor1_position=recording.motor_position,
        motor2_position=recording.motor_position,
        motor1_torque=recording.motor_torque,
        motor2_torque=recording.motor_torque,
    )
    side = observer(fit=RecursiveLeastSquares(1e12))
    one, pair = estimation.estimate(side, recording), estimation.estimate(AntagonisticPair(side), both)
    np.testing.assert_allclose(pair.stiffness, 2.0 * one.stiffness, rtol=1e-12)
    np.testing.assert_allclose(pair.stiffness_std, np.sqrt(2.0) * one.stiffness_std, rtol=1e-12)
    assert AntagonisticPair(side).needs == {
        "link_position",
        "motor1_position",
        "motor2_position",
        "motor1_torque",
        "motor2_torque",
    }
    assert len(pair.sides) == 2


@pytest.mark.analytic
def test_incomplete_windows_are_no_samples():
    # Counted as samples, 200 empty rows would have made the first complete one look certain: a deviation of 0.
    samples = 800
    recording, _ = consistent_recording(samples=samples)
    noise = 0.05 * np.random.default_rng(6).normal(size=samples)
    answer = estimation.estimate(observer(), recording._replace(motor_torque=recording.motor_torque + noise))
    # An average of the innovations forgets over half a window, and two of these pass before one shares nothing.
    silent = 2 * round(WINDOW / SAMPLE_TIME)
    assert np.all(np.isinf(answer.stiffness_std[:silent]))
    assert np.all(np.isfinite(answer.stiffness_std[round(1.2 * silent) :]))
    assert not np.any(answer.known[:silent])
