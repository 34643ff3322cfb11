import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vsajax.sensing import Clock, Encoder, Sensor

KEY = jax.random.key(0)
TIME = jnp.arange(501) * 1e-3
COUNT = 2.0 * np.pi / 1024


@pytest.mark.analytic
def test_encoder_rounds_to_the_nearest_count():
    positions = np.random.default_rng(0).uniform(-20.0, 20.0, 10_000)
    readings = np.asarray(Encoder(1024.0)(jnp.asarray(positions)))
    # 20 rad / count is below 2^12: rounding moves a reading by 1e-12 counts at most.
    np.testing.assert_allclose(readings / COUNT, np.round(readings / COUNT), atol=1e-11)
    assert np.max(np.abs(readings - positions)) <= (0.5 + 1e-11) * COUNT
    # All of the half-count is used: rounding to every second count, or truncation, would not.
    assert np.max(readings - positions) > 0.49 * COUNT
    assert np.min(readings - positions) < -0.49 * COUNT


@pytest.mark.analytic
def test_floor_encoder_never_reads_ahead():
    positions = np.random.default_rng(1).uniform(-20.0, 20.0, 10_000)
    lag = positions - np.asarray(Encoder(1024.0, rounding="floor")(jnp.asarray(positions)))
    assert np.min(lag) >= -1e-11
    assert 0.99 * COUNT < np.max(lag) < (1.0 + 1e-11) * COUNT


@pytest.mark.analytic
@pytest.mark.parametrize("rounding", ["nearest", "floor"])
def test_offset_shifts_readings_and_moves_the_edges(rounding):
    positions = jnp.linspace(-1.0, 1.0, 1001)
    plain = Encoder(1024.0, rounding=rounding)
    shifted = Encoder(1024.0, 0.3 * COUNT, rounding=rounding)
    np.testing.assert_array_equal(shifted(positions), plain(positions + 0.3 * COUNT))
    assert np.any(shifted(positions) != plain(positions))
    # A whole number of counts is a pure shift of the readings.
    whole = Encoder(1024.0, 5.0 * COUNT, rounding=rounding)
    inside = positions + 0.123456 * COUNT
    np.testing.assert_allclose(whole(inside), plain(inside) + 5.0 * COUNT, atol=1e-12)


@pytest.mark.analytic
def test_delay_shows_the_past_and_holds_the_first_value():
    signal = 3.0 + 2.0 * TIME
    reading = Sensor(delay=0.0105)(TIME, signal, key=KEY)
    expected = 3.0 + 2.0 * np.maximum(np.asarray(TIME) - 0.0105, 0.0)
    np.testing.assert_allclose(reading, expected, rtol=1e-14)


@pytest.mark.analytic
def test_gain_acts_before_the_bias():
    signal = jnp.sin(TIME)
    np.testing.assert_allclose(Sensor(gain=1.5, bias=0.2)(TIME, signal, key=KEY), 1.5 * signal + 0.2, rtol=1e-15)


def test_bias_adds_up_before_quantisation():
    signal = jnp.linspace(-1.0, 1.0, 501)
    encoder = Encoder(1024.0)
    np.testing.assert_array_equal(Sensor(bias=0.2, encoder=encoder)(TIME, signal, key=KEY), encoder(signal + 0.2))


@pytest.mark.analytic
def test_ideal_sensor_reads_the_truth():
    signal = jnp.linspace(-1.0, 1.0, 501)
    assert Sensor()(TIME, signal, key=KEY) is signal


@pytest.mark.statistical
def test_noise_is_white_with_its_standard_deviation():
    samples, std = 200_000, 0.3
    time = jnp.arange(samples) * 1e-3
    noise = np.asarray(Sensor(noise_std=std)(time, jnp.ones(samples), key=KEY)) - 1.0
    # Standard errors: mean σ/√N, standard deviation σ/√(2N), autocorrelation 1/√N; gates at 4 of them.
    assert abs(np.mean(noise)) < 4 * std / np.sqrt(samples)
    assert abs(np.std(noise) - std) < 4 * std / np.sqrt(2 * samples)
    for lag in (1, 2, 10):
        correlation = np.mean(noise[lag:] * noise[:-lag]) / np.var(noise)
        assert abs(correlation) < 4 / np.sqrt(samples)


@pytest.mark.contract
def test_noise_differs_between_keys_and_repeats_with_the_same():
    sensor, signal = Sensor(noise_std=0.1), jnp.zeros(501)
    first, again, other = (sensor(TIME, signal, key=jax.random.key(seed)) for seed in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    assert np.all(first != other)


@pytest.mark.gradient
def test_noise_scale_is_differentiable():
    # A reading is signal + std · unit noise: its slope in std is the unit noise.
    signal = jnp.zeros(501)
    slope = jax.jacfwd(lambda std: Sensor(noise_std=std)(TIME, signal, key=KEY))(jnp.asarray(0.1))
    np.testing.assert_allclose(slope, jax.random.normal(KEY, (501,)), rtol=1e-14)


@pytest.mark.analytic
def test_regular_clock_ticks_evenly_from_zero():
    clock = Clock(sample_time=1e-3, duration=0.25)
    times = clock.times(key=KEY)
    assert clock.samples == len(times) == 251
    np.testing.assert_allclose(times, np.arange(251) * 1e-3, rtol=1e-15)
    assert clock.intervals(times) == 1e-3
    assert clock.intervals(times).ndim == 0


@pytest.mark.statistical
@pytest.mark.parametrize("jitter", [1e-5, 2e-4, 1.0])
def test_jittered_clock_never_runs_backwards(jitter):
    clock = Clock(sample_time=1e-3, duration=5.0, jitter_std=jitter)
    times = np.asarray(clock.times(key=jax.random.key(7)))
    assert times[0] == 0.0
    # Each instant stays within 0.45 T of its place: neighbours are 0.1 T apart at least.
    assert np.min(np.diff(times)) >= 0.1e-3 - 1e-12
    np.testing.assert_allclose(clock.intervals(jnp.asarray(times)), np.diff(times))
    scatter = (times - np.arange(5001) * 1e-3)[1:]
    assert np.max(np.abs(scatter)) <= 0.45e-3 + 1e-12
    if jitter == 1e-5:
        # Uncut: the standard error of a standard deviation is 1/√(2N) of it.
        assert abs(np.std(scatter) - jitter) < 4 * jitter / np.sqrt(2 * 5000)
