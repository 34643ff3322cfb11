"""What keeps a broken sample out of an estimator or a controller that runs on a robot.

A recursion never forgets a NaN: one that enters a state stays in it and in every later answer. So a sample with a
reading that is not a number, or that no joint can have, is left out; of an estimator also one that has jumped
to where nothing can have got to, see `jumps`. The state stays as it was, the last answer is given again, marked
as held and not known, and the time that went by is added to the next sample's.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from vsajax.jumps import Jumps, judge, start, taken
from vsajax.types import Estimate, Recording, Scalar

LARGEST_READING = 1e9
"""Largest magnitude of a reading in SI units: no joint turns by so many radians, bears such a torque, or waits so
long. Powers of it, as features have them, stay finite in double precision."""


class GuardState(NamedTuple):
    """What is guarded, and what to answer while samples are left out.

    Args:
        inner: state of what is guarded.
        answer: the last one.
        started: whether any sample was sound.
        missed: time of the samples left out since the last sound one [s].
        jumps: what is known of its readings' changes; `None` of what is no estimator.
    """

    inner: Any
    answer: Any
    started: Bool[Array, ""]
    missed: Scalar
    jumps: Jumps | None = None


class Guarded[Module](eqx.Module):
    """Anything with `init` and `step` whose answers have `held` and `skipped`, safe from broken samples.

    Args:
        module: what is guarded.
    """

    module: Module

    def init(self, sample: Any) -> GuardState:
        """Return the state before the first sample, which may be broken: then the first sound one starts."""
        module: Any = self.module
        sound = is_sound(sample)
        first = _still(jax.tree.map(lambda x: jnp.where(sound, x, jnp.zeros_like(x)), sample))
        inner = module.init(first)
        _, answer = module.step(inner, first)
        jumps = start(stacked(first)) if isinstance(answer, Estimate) else None
        answer = not_known(answer)._replace(held=jnp.ones((), bool), skipped=jnp.zeros((), jnp.int32))
        return GuardState(inner, answer, sound, jnp.zeros(()), jumps)

    def step(self, state: GuardState, sample: Any) -> tuple[GuardState, Any]:
        """Process one sample; return (state, answer)."""
        module: Any = self.module
        sound, is_begun = is_sound(sample), state.started
        safe = jax.tree.map(lambda x: jnp.where(sound, x, jnp.zeros_like(x)), sample)
        taken, jumps, missed = sound, state.jumps, state.missed
        if jumps is not None:
            moved, verdict = judge(jumps, stacked(safe), safe.dt + missed)
            taken = sound & ~(is_begun & verdict.is_refused)
            jumps = _where(sound, _where(is_begun, moved, start(stacked(safe))), jumps)
            is_begun = is_begun & ~(sound & verdict.is_first)
        if hasattr(sample, "dt"):
            safe = safe._replace(dt=jnp.where(is_begun, safe.dt + missed, 0.0))
            missed = jnp.where(taken, 0.0, missed + jnp.where(_is_in_range(sample.dt, 0.0), sample.dt, 0.0))
        inner = _where(is_begun, state.inner, module.init(safe))
        moved, answer = module.step(inner, safe)
        # Where a run starts anew, its first sample is one that should have been left out.
        before = state.answer.skipped + (state.started & ~is_begun)
        skipped = jnp.where(taken, before, jnp.maximum(before, before + 1))
        held = not_known(state.answer)._replace(held=jnp.ones((), bool), skipped=skipped)
        answer = answer._replace(held=jnp.zeros((), bool), skipped=skipped)
        answer = _where(taken, answer, held)
        return GuardState(_where(taken, moved, state.inner), answer, state.started | sound, missed, jumps), answer


def is_sound(sample: Any) -> Bool[Array, "..."]:
    """Return whether a sample's readings are numbers within ±`LARGEST_READING`, and its time step is not negative.

    Args:
        sample: a named tuple of arrays, such as `Sample`. Where it has `readings`, only those count: what else it
            has is a wish, which the step itself refuses.
    """
    within = [jnp.all(_is_in_range(x, -LARGEST_READING)) for x in jax.tree.leaves(readings_of(sample))]
    if hasattr(sample, "dt"):
        within.append(sample.dt >= 0.0)
    return jnp.stack(within).all()


def are_taken(recording: Recording) -> Bool[Array, " time"]:
    """Return which samples of a recording are not left out: those that are sound and have not jumped."""
    readings = [x for x in recording[1:] if x is not None]
    in_range = [_is_in_range(x, -LARGEST_READING) for x in readings]
    sound = jnp.stack([jnp.isfinite(recording.time), *in_range]).all(0)
    return taken(jnp.stack(readings, axis=-1), recording.time, sound)


def stacked(sample: Any) -> Array:
    """Return the readings of an estimator's sample behind one another."""
    return jnp.stack(jax.tree.leaves(sample._replace(dt=None)))


def given_again(answers: Estimate, sound: Bool[Array, " time"], first: Estimate) -> Estimate:
    """Return the answers of sound samples at every sample: where one was left out, the last one before it.

    Args:
        answers: of the sound samples, one behind the other, `(time,)`; what follows them is not read.
        sound: which samples they belong to.
        first: what is answered before the first sound sample.
    """
    place = jnp.cumsum(sound) - 1
    skipped = jnp.cumsum(~sound).astype(jnp.int32)
    spread = jax.tree.map(lambda x: x[jnp.maximum(place, 0)], answers)
    marks = {"held": ~sound, "skipped": skipped}
    begun = first._replace(held=None, skipped=None)
    spread = jax.tree.map(lambda x, y: jnp.where(place >= 0, x, y), spread, begun)
    unknown = not_known(spread)
    return _where(sound, spread, unknown)._replace(**marks)


def readings_of(sample: Any) -> Any:
    """Return what must be sound of a sample."""
    return getattr(sample, "readings", sample)


def not_known(answer: Any) -> Any:
    """Return an estimate that is not known, its sides neither; any other answer as it is."""
    if not isinstance(answer, Estimate):
        return answer
    return answer._replace(known=jnp.zeros_like(answer.known), sides=tuple(map(not_known, answer.sides)))


def _is_in_range(reading: Array, lowest: float) -> Bool[Array, "..."]:
    return (reading >= lowest) & (reading <= LARGEST_READING)


def _still(sample: Any) -> Any:
    return sample._replace(dt=jnp.zeros_like(sample.dt)) if hasattr(sample, "dt") else sample


def _where(condition: Bool[Array, "..."], one: Any, other: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), one, other)
