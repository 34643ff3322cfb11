"""The fastest rule: its closed form against a simulation, and its place against a search."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.vsajax.swings import INERTIA
from vsajax import switching

RATIOS = {0.3: 0.0379, 0.5: 0.0123, 0.1: 0.1498, 0.3 / 13: 0.473}


def gain(ratio: float) -> float:
    r = jnp.asarray(ratio)
    best = switching.release_rate(r, switching.best_release(r))
    return float(best / switching.release_rate(r, jnp.zeros(())) - 1.0)


@pytest.mark.analytic
@pytest.mark.parametrize("ratio", RATIOS)
def test_gain_over_the_law(ratio):
    assert gain(ratio) == pytest.approx(RATIOS[ratio], rel=2e-2)


@pytest.mark.oracle
@pytest.mark.parametrize("ratio", RATIOS)
def test_release_is_where_a_fine_search_finds_it(ratio):
    delays = jnp.linspace(0.0, 1.5, 15001)
    rates = jax.vmap(lambda d: switching.release_rate(jnp.asarray(ratio), d))(delays)
    assert switching.best_release(jnp.asarray(ratio)) == pytest.approx(float(delays[jnp.argmax(rates)]), abs=1e-4)


@pytest.mark.analytic
def test_release_at_the_ratio_of_the_paper():
    assert switching.best_release(jnp.asarray(0.3)) == pytest.approx(0.1398, rel=2e-2)


@pytest.mark.oracle
def test_rate_is_that_of_the_motion():
    soft, stiff, delay = 0.3, 1.0, 0.14
    free = switching.Oscillator(jnp.asarray(INERTIA), jnp.asarray(0.0))
    out = jnp.asarray((np.pi / 2 + delay) / np.sqrt(stiff / INERTIA))
    turned = free.flow(switching.Phase(jnp.zeros(()), jnp.ones(())), jnp.asarray(stiff), out)
    back = free.time_to_centre(turned, jnp.asarray(soft))
    speed = float(free.flow(turned, jnp.asarray(soft), back).velocity)
    rate = -2.0 * np.log(abs(speed)) / float(out + back) / np.sqrt(soft / INERTIA)
    assert switching.release_rate(jnp.asarray(soft / stiff), jnp.asarray(delay)) == pytest.approx(rate, rel=1e-12)
