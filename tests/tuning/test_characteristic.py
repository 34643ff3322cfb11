"""Tangent, secant and hysteresis against springs whose answers are known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from tuning.logs.characteristic import characterise, directions

TIME = np.linspace(0.0, 3.0, 6001)
REACH = 0.02
SWING = REACH * np.sin(2 * np.pi * TIME)


def dry_spring(deflection: np.ndarray, *, soft: float, stuck: float, slip: float) -> np.ndarray:
    """Return a spring beside a dry friction element: stiffness soft + stuck until the element slips at `slip`."""
    force, torque = 0.0, np.empty_like(deflection)
    for k, step in enumerate(np.diff(deflection, prepend=deflection[0])):
        force = float(np.clip(force + stuck * step, -slip, slip))
        torque[k] = soft * deflection[k] + force
    return torque


@pytest.mark.analytic
def test_a_linear_spring_with_an_offset_is_a_line():
    line = characterise(SWING - 0.3, 50.0 * SWING + 1.5)
    assert line is not None
    assert line.stiffness == pytest.approx(50.0, rel=1e-9)
    assert line.torque_at_zero == pytest.approx(1.5 + 50.0 * 0.3, rel=1e-9)
    assert (line.is_line, line.causes) == (True, ())
    assert line.r_squared == pytest.approx(1.0, abs=1e-12)
    assert abs(line.loss_factor) < 1e-3
    for level in line.levels:
        assert level.secant == pytest.approx(50.0, rel=1e-6)
        assert level.tangent == pytest.approx(50.0, rel=1e-6)


@pytest.mark.analytic
@pytest.mark.parametrize(("cubic", "cause"), [(4e5, "stiffening"), (-5e4, "softening")])
def test_a_cubic_spring_bends_by_its_tangents(cubic, cause):
    line = characterise(SWING, 50.0 * SWING + cubic * SWING**3, rest=0.0)
    assert line is not None
    if cause == "stiffening":
        assert line.causes == ("stiffening",)
    for level in line.levels[1:-1]:
        a = level.amplitude
        # Pieces of the path are a fortieth of the reach long: what curves within one is averaged.
        assert level.secant == pytest.approx(50.0 + cubic * a**2, rel=0.05)
        assert level.tangent == pytest.approx(50.0 + 3 * cubic * a**2, rel=0.08)
    assert abs(line.loss_factor) < 0.01
    assert line.branches < 0.05


@pytest.mark.analytic
def test_dry_friction_inside_a_spring_is_hysteresis_with_the_width_and_loss_of_its_element():
    soft, stuck, slip = 40.0, 400.0, 1.0
    line = characterise(SWING, dry_spring(SWING, soft=soft, stuck=stuck, slip=slip))
    assert line is not None
    assert line.causes[0] == "hysteresis"
    assert "softening" in line.causes
    assert line.width == pytest.approx(2 * slip, rel=0.1)
    # A slipping element loses 4·slip·(reach − slip/stuck) a cycle.
    assert line.loss == pytest.approx(4 * slip * (REACH - slip / stuck), rel=0.1)
    # After a turn the element sticks over 2·slip/stuck: a swing of that half has both stiffnesses.
    assert line.swings[0].secant == pytest.approx(soft + stuck, rel=0.05)
    assert line.swings[-1].secant == pytest.approx(soft + slip / (REACH * 15 / 16), rel=0.05)


def test_noise_neither_bends_nor_loops():
    rng = np.random.default_rng(2)
    line = characterise(SWING, 50.0 * SWING + 0.4 * rng.normal(size=SWING.size))
    assert line is not None
    # R² is below 0.98, but of noise alone.
    assert not line.is_line
    assert line.causes == ()


def test_a_zero_that_slips_is_seen_from_start_to_end():
    line = characterise(SWING + 0.004 * (TIME > 1.6), 50.0 * SWING)
    assert line is not None
    assert line.shift == pytest.approx(0.004, rel=0.2) or line.shift == pytest.approx(-0.004, rel=0.2)


def test_what_does_not_move_has_no_characteristic():
    assert characterise(np.zeros(50), np.arange(50.0)) is None
    assert characterise(np.arange(50.0), np.zeros(50)) is None


def test_directions_follow_the_swing_not_the_noise():
    rng = np.random.default_rng(5)
    noisy = SWING + 0.02 * REACH * rng.normal(size=SWING.size)
    way, truth = directions(noisy), np.sign(np.cos(2 * np.pi * TIME))
    # Noise of six percent at most moves an extremum to where the sine is above 0.88.
    clear = np.abs(np.cos(2 * np.pi * TIME)) > 0.5
    # The first samples are noise about a start that is no turn.
    clear[:20] = False
    np.testing.assert_array_equal(way[clear], truth[clear])
    assert directions(np.repeat(noisy, 10)).size == 10 * noisy.size
