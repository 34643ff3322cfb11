import dataclasses
import inspect
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import kurtosis

from vsajax import sensing
from vsajax.sensing import BandLimitedNoise, Chirp, Excitation, Multisine, Recorded, Sine

TIME = jnp.linspace(0.0, 3.0, 301)
T = np.asarray(TIME)
# One sine of an angle below 1e3 rad, itself rounded by ε/2: 1e-13 of the amplitude.
ABSOLUTE = 1e-12

EXCITATIONS = {
    "sine": Sine(0.3, 0.1, 0.2, 0.05),
    "multisine": Multisine([1.0, 2.0], [0.5, 3.0], [0.1, 0.2], 0.3),
    "chirp": Chirp(2.0, 0.5, 4.0, 2.0, 0.1),
    "noise": BandLimitedNoise(1.5, 2.0, 5.0, 0.2, seed=3),
    "recorded": Recorded([0.0, 1.0, 3.0], [0.0, 2.0, 1.0]),
}

each_excitation = pytest.mark.parametrize("excitation", EXCITATIONS.values(), ids=EXCITATIONS.keys())


@pytest.mark.contract
def test_registry_holds_every_excitation():
    classes = {cls for _, cls in inspect.getmembers(sensing, inspect.isclass)}
    excitations = {cls for cls in classes if issubclass(cls, sensing.AbstractExcitation)}
    assert {type(e) for e in EXCITATIONS.values()} == excitations - {sensing.AbstractExcitation}


@pytest.mark.contract
@each_excitation
def test_torque_is_a_function_of_time_alone(excitation):
    series = excitation(TIME)
    one_by_one = jnp.stack([excitation(t) for t in TIME[::50]])
    table = excitation(TIME[:300].reshape(20, 15))
    np.testing.assert_allclose(series[::50], one_by_one, atol=ABSOLUTE)
    np.testing.assert_allclose(series[:300].reshape(20, 15), table, atol=ABSOLUTE)


@pytest.mark.contract
@each_excitation
def test_torque_has_finite_gradients(excitation):
    if isinstance(excitation, BandLimitedNoise):
        # Its tones are unrolled: 32 of them differentiate like four, and compile for seconds.
        excitation = dataclasses.replace(excitation, tones=4)
    slopes = jax.jit(jax.grad(lambda e: jnp.sum(e(TIME) ** 2)))(excitation)
    assert np.all([np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(slopes)])


@pytest.mark.analytic
def test_sine():
    expected = 0.05 + 0.3 * np.sin(2 * np.pi * 0.1 * T + 0.2)
    np.testing.assert_allclose(EXCITATIONS["sine"](TIME), expected, atol=ABSOLUTE)
    np.testing.assert_array_equal(Sine()(TIME), 0.0)


@pytest.mark.analytic
def test_multisine_adds_its_tones():
    expected = 0.3 + np.sin(2 * np.pi * 0.5 * T + 0.1) + 2.0 * np.sin(2 * np.pi * 3.0 * T + 0.2)
    np.testing.assert_allclose(EXCITATIONS["multisine"](TIME), expected, atol=ABSOLUTE)


@pytest.mark.analytic
def test_chirp_sweeps_linearly_and_starts_again():
    # From 0.5 to 4 Hz in 2 s: the phase is the integral of the frequency.
    elapsed = T % 2.0
    cycles = np.array(
        [np.trapezoid(0.5 + 1.75 * np.linspace(0, e, 2001), np.linspace(0, e, 2001)) for e in elapsed]
    )
    expected = 0.1 + 2.0 * np.sin(2 * np.pi * cycles)
    np.testing.assert_allclose(EXCITATIONS["chirp"](TIME), expected, atol=1e-11)


@pytest.mark.analytic
def test_recorded_torque_is_interpolated_and_held():
    time = jnp.asarray([-1.0, 0.0, 0.5, 1.0, 2.0, 3.0, 9.0])
    np.testing.assert_allclose(EXCITATIONS["recorded"](time), [0.0, 0.0, 1.0, 2.0, 1.5, 1.0, 1.0], atol=1e-15)


@pytest.fixture(scope="module")
def noise():
    """A long stretch of band-limited noise at 200 Hz, and its offset."""
    time = jnp.arange(400_000) / 200.0
    return np.asarray(jax.jit(lambda e, t: e(t))(EXCITATIONS["noise"], time)) - 0.2


@pytest.mark.statistical
def test_band_limited_noise_has_its_standard_deviation(noise):
    # Tones closer than the resolution 1/2000 s = 5e-4 Hz would beat; 32 tones in 3 Hz are 0.1 Hz apart on average.
    # Their powers add up to std², each to within 1/(2π·2000 s·0.1 Hz) = 1e-3.
    assert np.std(noise) == pytest.approx(1.5, rel=5e-3)
    assert abs(np.mean(noise)) < 1e-3 * 1.5


@pytest.mark.analytic
def test_band_limited_noise_stays_in_its_band(noise):
    # With a Hann window, leakage beyond 0.1 Hz (200 bins) from a tone falls below 1e-10 of its power.
    spectrum = np.abs(np.fft.rfft(noise * np.hanning(len(noise)))) ** 2
    frequency = np.fft.rfftfreq(len(noise), 1 / 200.0)
    outside = (frequency < 1.9) | (frequency > 5.1)
    assert np.sum(spectrum[outside]) < 1e-9 * np.sum(spectrum)
    # Each of 32 equal shares of the band holds one tone of equal power; one near an edge may leak into the next.
    edges = np.linspace(2.0, 5.0, 33)
    shares = [np.sum(spectrum[(frequency >= a) & (frequency < b)]) for a, b in itertools.pairwise(edges)]
    np.testing.assert_allclose(np.array(shares) / np.sum(spectrum), 1 / 32, rtol=0.05)


@pytest.mark.statistical
def test_band_limited_noise_is_nearly_gaussian(noise):
    # The excess kurtosis of 32 independent sines is −1.5/32 = −0.047; 3 Hz · 2000 s = 6000 independent values
    # leave √(24/6000) = 0.063.
    assert abs(kurtosis(noise) + 1.5 / 32) < 4 * 0.063


@pytest.mark.contract
def test_noise_is_fixed_by_its_seed():
    same, other = (BandLimitedNoise(1.5, 2.0, 5.0, 0.2, seed=seed)(TIME) for seed in (3, 4))
    np.testing.assert_array_equal(EXCITATIONS["noise"](TIME), same)
    assert np.max(np.abs(other - same)) > 1.0


@pytest.mark.contract
def test_excitation_names_the_inputs_and_is_silent_on_the_others():
    torques = Excitation(external=Sine(0.3, 0.1)).torques(TIME)
    names = [field for field in Excitation.__dataclass_fields__]
    assert len(torques) == len(names)
    for name, torque in zip(names, torques, strict=True):
        expected = Sine(0.3, 0.1)(TIME) if name == "external" else np.zeros(len(T))
        np.testing.assert_array_equal(torque, expected, err_msg=name)


@pytest.mark.contract
def test_excitation_drives_the_inputs_that_joints_have():
    from vsajax.plants import Torques

    assert tuple(Excitation.__dataclass_fields__) == Torques._fields
