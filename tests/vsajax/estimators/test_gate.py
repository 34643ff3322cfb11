import jax.numpy as jnp
import pytest

from vsajax.estimators import ExcitationGate

pytestmark = pytest.mark.analytic


def answers(gate, deflections, stiffnesses, stds):
    state, known = gate.init(jnp.asarray(deflections[0])), []
    for sample in zip(deflections, stiffnesses, stds, strict=True):
        state, is_known = gate.step(state, *map(jnp.asarray, sample))
        known.append(bool(is_known))
    return known


def test_stiffness_is_known_once_moved_and_tight():
    gate = ExcitationGate(min_deflection_range=0.01, max_relative_std=0.1)
    deflections = [0.50, 0.505, 0.51, 0.505, 0.505]
    assert answers(gate, deflections, [100.0] * 5, [1.0, 1.0, 1.0, 11.0, 10.0]) == [
        False,
        False,
        True,
        False,
        True,
    ]


def test_range_counts_from_the_smallest_to_the_largest_so_far():
    gate = ExcitationGate(min_deflection_range=0.02, max_relative_std=0.1)
    assert answers(gate, [0.0, 0.011, 0.0, -0.011, 0.0], [1.0] * 5, [0.0] * 5) == [False] * 3 + [True] * 2


def test_std_counts_relative_to_the_size_of_the_stiffness():
    gate = ExcitationGate(max_relative_std=0.1)
    assert answers(gate, [0.0] * 3, [-100.0, 1.0, 0.0], [5.0, 5.0, 0.1]) == [True, False, False]


def test_absent_posterior_is_never_known():
    gate = ExcitationGate()
    nan, inf = float("nan"), float("inf")
    assert answers(gate, [0.0] * 3, [100.0, 100.0, nan], [nan, inf, 1.0]) == [False] * 3
