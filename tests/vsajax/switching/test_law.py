"""Law (23) in closed form: against the event-accurate reference, and against integration."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.vsajax.swings import DAMPING, IMPULSE, INERTIA, SOFT, STIFF
from vsajax import switching

LINK = switching.Oscillator(jnp.asarray(INERTIA), jnp.asarray(DAMPING))
RANGES = {"soft": (SOFT, SOFT), "stiff": (STIFF, STIFF), "law": (SOFT, STIFF)}
each = pytest.mark.parametrize("name", RANGES)


def exact(name: str, **blow) -> switching.Exact:
    soft, stiff = map(jnp.asarray, RANGES[name])
    return switching.exact_motion(LINK, soft, stiff, **(blow or {"impulse": IMPULSE}))


@pytest.mark.oracle
@each
def test_impulse_is_the_reference(name, swings):
    motion = exact(name)
    phase, _ = motion.at(LINK, jnp.asarray(swings["t"]))
    np.testing.assert_allclose(phase.position, swings[f"{name}_x"], rtol=0, atol=1e-9)
    np.testing.assert_allclose(phase.velocity, swings[f"{name}_v"], rtol=0, atol=1e-8)
    assert motion.settling_time(LINK, jnp.asarray(0.05)) == pytest.approx(swings[f"{name}_settle"], abs=1e-9)


@pytest.mark.oracle
@each
def test_pulse_is_the_reference(name, swings):
    motion = exact(name, pulse=(1.0, 0.05))
    phase, _ = motion.at(LINK, jnp.asarray(swings["t"]))
    np.testing.assert_allclose(phase.position, swings[f"rect50_{name}_x"], rtol=0, atol=1e-9)
    settled = motion.settling_time(LINK, jnp.asarray(0.05))
    assert settled == pytest.approx(swings[f"rect50_{name}_settle"], abs=1e-9)


@pytest.mark.oracle
def test_switches_are_the_reference(swings):
    np.testing.assert_allclose(exact("law").switch_times[:20], swings["law_switch_times"], rtol=0, atol=1e-9)


@pytest.mark.oracle
def test_a_leg_is_what_an_integrator_finds():
    start = switching.Phase(jnp.asarray(0.4), jnp.asarray(-3.0))

    def rates(t, x):
        return [x[1], (0.2 - DAMPING * x[1] - 0.7 * x[0]) / INERTIA]

    found = solve_ivp(rates, (0.0, 0.31), [0.4, -3.0], "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    flown = LINK.flow(start, jnp.asarray(0.7), jnp.asarray(0.31), jnp.asarray(0.2))
    np.testing.assert_allclose(flown, found, rtol=1e-9)


@pytest.mark.analytic
def test_events_lie_where_they_say_from_all_quadrants():
    rng = np.random.default_rng(0)
    start = switching.Phase(*jnp.asarray(rng.normal(size=(2, 200))))
    stiffness = jnp.asarray(rng.uniform(0.2, 2.0, 200))
    half = jnp.pi / LINK.rates(stiffness)[1]
    for event, value in ((LINK.time_to_peak, 1), (LINK.time_to_centre, 0)):
        time = event(start, stiffness)
        np.testing.assert_allclose(LINK.flow(start, stiffness, time)[value], 0.0, atol=1e-10)
        assert ((time > 0.0) & (time <= half * (1 + 1e-12))).all()


@pytest.mark.analytic
def test_decay_rates():
    at_soft = switching.decay_rate(LINK, jnp.asarray(SOFT), jnp.asarray(SOFT))
    assert at_soft == pytest.approx(DAMPING / 2 / INERTIA, rel=1e-12)
    law = switching.decay_rate(LINK, jnp.asarray(SOFT), jnp.asarray(STIFF))
    # From the reference's own trajectory: the peaks of whole swings.
    motion = exact("law")
    peaks = np.abs(np.asarray(motion.position))[1::2]
    times = np.asarray(motion.start)[1::2]
    assert law == pytest.approx(np.log(peaks[2] / peaks[12]) / (times[12] - times[2]), rel=1e-9)
    # Without friction: k_min/k_max of the energy in a quarter period at each stiffness.
    free = switching.Oscillator(jnp.asarray(INERTIA), jnp.asarray(0.0))
    rate = 2.0 * switching.decay_rate(free, jnp.asarray(SOFT), jnp.asarray(STIFF))
    quarter = 0.5 * np.pi * (np.sqrt(INERTIA / SOFT) + np.sqrt(INERTIA / STIFF))
    assert rate == pytest.approx(-np.log(SOFT / STIFF) / quarter, rel=1e-12)
    assert rate == pytest.approx(4.7507, rel=1e-3)
