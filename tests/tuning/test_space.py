"""Bounded numbers as an unbounded vector and back."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tuning.search.space import Space
from tuning.study.ranges import Bounds

BOUNDS = {
    "gain": Bounds(low=3.0, high=1500.0),
    "variance": Bounds(low=1e4, high=1e13),
    "offset": Bounds(low=-2.0, high=5.0, scale="linear"),
}
SPACE = Space.of(BOUNDS)
shares = st.lists(st.floats(1e-3, 1.0 - 1e-3), min_size=3, max_size=3).map(jnp.array)
# One compilation each: hypothesis calls them hundreds of times.
AT_SHARE = jax.jit(lambda share: SPACE.at_share(share))
CONSTRAIN = jax.jit(lambda z: SPACE.constrain(z))
SLOPES = jax.jit(jax.jacfwd(lambda z: SPACE.constrain(z)))
UNCONSTRAIN = jax.jit(lambda values: SPACE.unconstrain(values))


def test_a_space_has_one_dimension_a_number():
    assert SPACE.size == 3
    assert SPACE.paths == tuple(BOUNDS)


@pytest.mark.analytic
def test_half_way_is_the_geometric_or_the_arithmetic_mean():
    middle = SPACE.constrain(jnp.zeros(3))
    np.testing.assert_allclose(middle["gain"], np.sqrt(3.0 * 1500.0), rtol=1e-14)
    np.testing.assert_allclose(middle["offset"], 1.5, rtol=1e-14)


@pytest.mark.equivalence
@settings(deadline=None)
@given(shares)
def test_numbers_come_back_from_the_vector_and_the_vector_from_numbers(share):
    values = AT_SHARE(share)
    again = CONSTRAIN(UNCONSTRAIN(values))
    for path in BOUNDS:
        # exp(ln x) of |ln x| up to 30 loses up to 30 rounding errors.
        np.testing.assert_allclose(again[path], values[path], rtol=30 * 2.0**-52, atol=1e-14)
    # d share/dz is at least 1e-3 there, and z at most 7: eps·7/1e-3.
    np.testing.assert_allclose(UNCONSTRAIN(CONSTRAIN(UNCONSTRAIN(values))), UNCONSTRAIN(values), atol=1e-11)


@settings(deadline=None)
@given(st.lists(st.floats(-1e308, 1e308), min_size=3, max_size=3).map(jnp.array))
def test_no_vector_leaves_the_bounds(z):
    values = CONSTRAIN(z)
    for path, bounds in BOUNDS.items():
        # The ends themselves come through exp and log.
        slack = 30 * 2.0**-52 * max(abs(bounds.low), abs(bounds.high))
        assert bounds.low - slack <= values[path] <= bounds.high + slack


@settings(deadline=None)
@given(st.floats(1e-6, 1e20), st.floats(1e-6, 1e20), st.floats(-1e6, 1e6))
def test_a_start_beyond_its_bounds_is_put_just_inside(gain, variance, offset):
    start = {"gain": jnp.array(gain), "variance": jnp.array(variance), "offset": jnp.array(offset)}
    z = UNCONSTRAIN(start)
    # A share within [1e-3, 1 − 1e-3] is |z| ≤ ln 999.
    assert jnp.all(jnp.abs(z) <= jnp.log(999.0) * (1 + 1e-12))
    values = CONSTRAIN(z)
    for path, bounds in BOUNDS.items():
        assert bounds.low < values[path] < bounds.high


@pytest.mark.gradient
@pytest.mark.parametrize("share", [0.0, 1.0, 0.5])
def test_the_gradient_is_finite_and_not_lost_at_the_bounds(share):
    at_share = SPACE.at_share(jnp.full(3, share))
    start = SPACE.unconstrain(at_share)
    slopes = SLOPES(start)
    for i, path in enumerate(BOUNDS):
        assert jnp.isfinite(slopes[path]).all()
        assert slopes[path][i] > 0.0
        assert jnp.count_nonzero(slopes[path]) == 1
    back = jax.jacfwd(SPACE.unconstrain)(SPACE.at_share(jnp.full(3, 0.3 + 0.4 * share)))
    assert all(jnp.isfinite(back[path]).all() for path in BOUNDS)


@pytest.mark.gradient
@settings(deadline=None, max_examples=25)
@given(shares)
def test_the_slope_is_that_of_a_logistic_on_the_scale(share):
    z = jnp.log(share) - jnp.log1p(-share)
    slopes = SLOPES(z)
    values = CONSTRAIN(z)
    rise = share * (1.0 - share)
    # Error of 1 − u for u up to 0.999: eps/1e-3.
    np.testing.assert_allclose(slopes["offset"][2], 7.0 * rise[2], rtol=1e-11)
    np.testing.assert_allclose(slopes["gain"][0], values["gain"] * np.log(500.0) * rise[0], rtol=1e-11)
    np.testing.assert_allclose(slopes["variance"][1], values["variance"] * np.log(1e9) * rise[1], rtol=1e-11)
