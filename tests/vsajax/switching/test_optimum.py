"""The optimum behind law (23): against the reference, the corrected printed equations, and another search."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize

from tests.vsajax.swings import INERTIA, SOFT, STIFF
from vsajax import switching
from vsajax.switching import EndCost, Phase

W_SOFT, W_STIFF = (jnp.sqrt(jnp.asarray(k / INERTIA)) for k in (SOFT, STIFF))
PHI, E_MIN = EndCost.printed(), EndCost.energy(jnp.asarray(SOFT), jnp.asarray(INERTIA))
E_MAX = EndCost.energy(jnp.asarray(STIFF), jnp.asarray(INERTIA))
START = Phase(jnp.zeros(()), jnp.ones(()))


@eqx.filter_jit
def best(time, cost):
    return switching.optimum(START, time, cost, W_SOFT, W_STIFF)


@pytest.mark.oracle
@pytest.mark.parametrize(
    ("cost", "time", "value", "tolerance"),
    [(PHI, 0.15, 2.875560e-3, 1e-4), (E_MIN, 0.75, 6.220293e-3, 1e-3), (PHI, 0.75, 6.9692e-5, 1e-4)],
)
def test_least_costs_are_the_reference(cost, time, value, tolerance):
    assert best(jnp.asarray(time), cost).cost == pytest.approx(value, rel=tolerance)


@pytest.mark.analytic
@pytest.mark.parametrize(("switch", "cost"), [(1, E_MAX), (2, E_MIN), (2, PHI)], ids=["centre", "peak", "peak, φ"])
def test_at_its_own_switches_law_23_is_the_optimum(switch, cost):
    # The end lies on an axis of the phase plane, where no bracket of directions holds it.
    free = switching.Oscillator(jnp.asarray(INERTIA), jnp.zeros(()))
    law = switching.exact_motion(free, jnp.asarray(SOFT), jnp.asarray(STIFF), impulse=INERTIA)
    time = law.switch_times[switch]
    assert best(time, cost).cost == pytest.approx(float(cost.of(law.at(free, time)[0])), rel=1e-9)
    assert best(time + 0.02, PHI).cost < 0.9 * float(PHI.of(law.at(free, time + 0.02)[0]))


@pytest.mark.equivalence
def test_the_optimum_leads_from_the_start_to_its_cost():
    time = jnp.asarray(0.4)
    found = best(time, PHI).extremal
    np.testing.assert_allclose(np.abs(found.start), [0.0, 1.0], atol=1e-9)
    durations = np.asarray(found.durations)
    assert durations.sum() == pytest.approx(0.4, abs=1e-12)
    # Forwards again: the intervals are stored from the last to the first.
    used = np.flatnonzero(durations > 1e-9)[::-1]
    switches = jnp.cumsum(jnp.asarray(durations[used]))[:-1]
    first = bool(found.is_stiff[used[0]])
    end = switching.switched_end(found.start, switches, time, W_SOFT, W_STIFF, first_stiff=first)
    np.testing.assert_allclose(end, found.end, atol=1e-9)


@pytest.mark.oracle
@pytest.mark.parametrize("time", [0.15, 0.2535])
def test_no_other_switching_times_are_better(time):
    # Switching-time optimisation: another way, local, from many starts.
    @jax.jit
    @jax.value_and_grad
    def cost(shares):
        switches = time * jnp.sort(shares)
        return 1e3 * PHI.of(
            switching.switched_end(START, switches, jnp.asarray(time), W_SOFT, W_STIFF, first_stiff=True)
        )

    rng = np.random.default_rng(0)
    found = min(
        minimize(cost, rng.uniform(size=2), jac=True, bounds=[(0.0, 1.0)] * 2, options={"ftol": 1e-15}).fun
        for _ in range(12)
    )
    assert best(jnp.asarray(time), PHI).cost * 1e3 == pytest.approx(found, rel=1e-6)


@pytest.mark.analytic
def test_intervals_are_9_and_10_and_not_11():
    # (11) is the principal arctangent: in a quadrant it is π/w too small, and negative.
    rng = np.random.default_rng(1)
    x, v, w = rng.normal(size=(3, 500))
    w = np.abs(w) + 0.1
    printed_9 = 2 / w * np.arctan(-v / (x * w) + np.sqrt(1 + (v / (x * w)) ** 2))
    found = switching.time_since_centre(Phase(jnp.asarray(x), jnp.asarray(v)), jnp.asarray(w))
    np.testing.assert_allclose(found, printed_9, rtol=1e-9)
    printed_10 = 2 / w * np.arctan(x / (v * w) + np.sqrt(1 + (x / (v * w)) ** 2))
    found = switching.time_since_turn(Phase(jnp.asarray(x), jnp.asarray(v)), jnp.asarray(w))
    np.testing.assert_allclose(found, printed_10, rtol=1e-9)
    printed_11 = np.arctan(x * w / v) / w
    assert 0.3 < np.mean(printed_11 < 0) < 0.7


@pytest.mark.analytic
@pytest.mark.parametrize("ends_at", ["centre", "peak"])
def test_extremals_that_end_on_an_axis_are_the_printed_sequences(ends_at):
    # Sec. IV, with k counted backwards from T (E5): amplitudes grow by w_x/w_λ every two switches.
    # On its way to the axis: soft to the centre, stiff to the peak.
    ends = {"centre": (-1e-12, 1.0), "peak": (1.0, 1e-12)}
    end = Phase(*map(jnp.asarray, ends[ends_at]))
    quarters = [0.5 * np.pi / W_SOFT, 0.5 * np.pi / W_STIFF]
    if ends_at == "peak":
        quarters.reverse()
    ratio = float(W_STIFF / W_SOFT)
    for k in range(1, 6):
        time = jnp.asarray(sum(quarters[i % 2] for i in range(k)))
        found = switching.extremal_to(end, time, PHI, W_SOFT, W_STIFF, intervals=12).start
        if ends_at == "centre":
            odd = -(ratio ** ((k - 1) / 2)) / float(W_SOFT) * np.sin(k * np.pi / 2)
            wanted = (odd, 0.0) if k % 2 else (0.0, ratio ** (k / 2) * np.cos(k * np.pi / 2))
        else:
            odd = ratio ** ((k - 1) / 2) * float(W_STIFF) * np.sin(k * np.pi / 2)
            wanted = (0.0, odd) if k % 2 else (ratio ** (k / 2) * np.cos(k * np.pi / 2), 0.0)
        np.testing.assert_allclose(found, wanted, atol=1e-8 * max(1.0, *map(abs, wanted)))
