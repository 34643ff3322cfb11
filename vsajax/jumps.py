"""Readings that jump to where nothing can have got to within a sample: outliers, lost bits, a glitch on a bus.

A recursive fit never forgets one either, however sound it is as a number: a deflection of 1e8 rad decides its
coefficient for good. So a sample is refused where a reading has changed by more than `FACTOR` times the largest
change that was taken of it before, in a step no longer than any before it. What stays is no outlier: after
`PATIENCE` refused samples the next is taken, and its change with it.

A reading that has never changed says nothing of its changes; then `LEAST` is too much. Where no reading had
changed before what stays, it is the first sample that was the outlier: the run starts anew.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from vsajax import rollout
from vsajax.types import Scalar

FACTOR = 20.0
"""Of the largest change so far."""
LEAST = 1.0
"""Change of a reading that had none yet, in SI units."""
PATIENCE = 3
"""Samples refused in a row."""

Readings = Float[Array, " signal"]


class Jumps(NamedTuple):
    """What is known of readings' changes.

    Args:
        last: the readings taken last.
        largest: the largest change of each.
        longest: the longest step between two that were taken [s].
        refused: how many were refused since.
    """

    last: Readings
    largest: Readings
    longest: Scalar
    refused: Int[Array, ""]


class Verdict(NamedTuple):
    """What to do with a sample: leave it out, or take it; and if so, whether it is a new first one."""

    is_refused: Bool[Array, ""]
    is_first: Bool[Array, ""]


def start(readings: Readings) -> Jumps:
    """Return what is known after the first sample."""
    still = jnp.zeros_like(readings)
    return Jumps(readings, still, jnp.zeros(()), jnp.zeros((), jnp.int32))


def judge(state: Jumps, readings: Readings, dt: Scalar) -> tuple[Jumps, Verdict]:
    """Judge the next sample; return (state, verdict).

    Args:
        state: after the sample before it.
        readings: numbers, all of them.
        dt: time since the last sample that was taken [s].
    """
    change = jnp.abs(readings - state.last)
    longer = jnp.where(state.longest > 0.0, jnp.maximum(dt / state.longest, 1.0), 1.0)
    far = change > jnp.where(state.largest > 0.0, FACTOR * state.largest * longer, LEAST)
    is_far, is_patient = jnp.any(far), state.refused < PATIENCE
    is_still = jnp.all(state.largest == 0.0)
    verdict = Verdict(is_far & is_patient, is_far & ~is_patient & is_still)
    taken = Jumps(
        readings,
        jnp.maximum(state.largest, change),
        jnp.maximum(state.longest, dt),
        jnp.zeros_like(state.refused),
    )
    refused = state._replace(refused=state.refused + 1)
    moved = _where(verdict.is_refused, refused, _where(verdict.is_first, start(readings), taken))
    return moved, verdict


def taken(
    readings: Float[Array, "time signal"], time: Float[Array, " time"], sound: Bool[Array, " time"]
) -> Bool[Array, " time"]:
    """Return which of a recording's sound samples are taken; none that a new first one follows.

    Args:
        readings: of all samples, sound or not.
        time: [s].
        sound: which samples are numbers throughout.
    """
    safe = jnp.where(sound[:, None], readings, 0.0)

    def step(carried: tuple[Jumps, Scalar, Bool[Array, ""]], row: tuple[Readings, Scalar, Bool[Array, ""]]):
        state, before, has_begun = carried
        one, now, is_sound = row
        moved, verdict = judge(state, one, now - before)
        moved = _where(has_begun, moved, start(one))
        is_taken = is_sound & ~(has_begun & verdict.is_refused)
        state = _where(is_sound, moved, state)
        carried = state, jnp.where(is_taken, now, before), has_begun | is_sound
        return carried, (is_taken, is_sound & has_begun & verdict.is_first)

    first = start(jnp.zeros_like(safe[0])), jnp.zeros(()), jnp.zeros((), bool)
    is_taken, is_first = rollout.scan(step, first, (safe, time, sound))[1]
    # Whatever came before the last new beginning.
    follows = jnp.cumsum(is_first[::-1])[::-1] - is_first
    return is_taken & (follows == 0)


def _where[Tree](condition: Bool[Array, ""], one: Tree, other: Tree) -> Tree:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), one, other)
