"""Better poses: a redundant arm moves in its nullspace while the hand stays where it is."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from vsajax import numerics, rollout
from vsajax.arms import SerialArm
from vsajax.types import Scalar

Joints = Float[Array, " joints"]
Ranges = Float[Array, "joints 2"]

_REACHED = 1e-9
_FIRST = 0.1
_LONGEST = 0.4
_SHORTEST = 1e-6
_DAMPING = 1e-8


class PoseSearch(NamedTuple):
    """Where a search ended.

    Args:
        positions: q [rad].
        initial: value of the objective at the start; infinite where the start does not have the hand in place.
        value: of the objective at `positions`.
        shift: of the hand from where it was to be [m].
    """

    positions: Joints
    initial: Scalar
    value: Scalar
    shift: Scalar


def reach(
    arm: SerialArm, positions: Joints, hand: Float[Array, "3"], ranges: Ranges, *, steps: int = 40
) -> tuple[Joints, Scalar]:
    """Return joint positions near the given ones that put the hand at a place, and how far off it still is [m].

    Damped Gauss–Newton in the least motion of the joints, which stay within their ranges; a joint that is pushed
    against its end is left there for the step.

    Args:
        arm: any.
        positions: where to start [rad].
        hand: where its position is to be [m].
        ranges: low and high end of every joint [rad].
        steps: of the iteration.
    """

    def approach(q: Joints) -> Joints:
        offset = hand - arm.forward(q).position
        jacobian = arm.position_jacobian(q)
        move = _least(jacobian, offset)
        inside = jnp.where(_is_pushed_out(q, move, ranges), 0.0, 1.0)
        move = inside * _least(jacobian * inside, offset)
        return jnp.clip(q + move * jnp.minimum(1.0, 0.5 / jnp.maximum(jnp.abs(move).max(), 1e-12)), *ranges.T)

    q = rollout.repeat(approach, jnp.clip(positions, *ranges.T), times=steps)
    return q, _length(hand - arm.forward(q).position)


def improve_pose(
    objective: Callable[[Joints], Scalar],
    arm: SerialArm,
    positions: Joints,
    hand: Float[Array, "3"],
    ranges: Ranges,
    *,
    steps: int,
) -> PoseSearch:
    """Return a pose with the hand at the same place and a lower objective: descent in the nullspace.

    Each step goes along the gradient's part that leaves the hand, joints at their ends taken out, puts the hand
    back, and is kept where the objective fell; its length grows by half then, and else falls to a third.

    Args:
        objective: of q; differentiable.
        arm: any.
        positions: where to start, with the hand in place to 1e-9 m; values stay infinite where it is not [rad].
        hand: where the hand's position is to stay [m].
        ranges: low and high end of every joint [rad].
        steps: tried.
    """

    def both(q: Joints) -> tuple[Scalar, Joints]:
        def twice(q: Joints) -> tuple[Scalar, Scalar]:
            value = objective(q)
            return value, value

        slope, value = jax.jacfwd(twice, has_aux=True)(q)
        return value, slope

    def descend(now: _Descent) -> _Descent:
        jacobian = arm.position_jacobian(now.positions)
        along = _within_nullspace(jacobian, -now.slope, jnp.ones_like(now.slope))
        inside = jnp.where(_is_pushed_out(now.positions, along, ranges), 0.0, 1.0)
        along = _within_nullspace(jacobian, -now.slope, inside)
        step = now.length * along * numerics.safe_divide(jnp.ones(()), _length(along))
        tried, shift = reach(arm, now.positions + step, hand, ranges, steps=4)
        value, slope = both(tried)
        better = (value < now.value) & (shift < _REACHED)
        length = jnp.where(better, jnp.minimum(1.5 * now.length, _LONGEST), now.length / 3.0)
        return _Descent(
            jnp.where(better, tried, now.positions),
            jnp.where(jnp.isinf(now.initial) & better, value, now.initial),
            jnp.where(better, value, now.value),
            jnp.where(better, slope, now.slope),
            jnp.maximum(length, _SHORTEST),
        )

    # The first step has no slope and so only evaluates the start: the objective is compiled once.
    nothing = jnp.asarray(jnp.inf)
    start = _Descent(positions, nothing, nothing, jnp.zeros_like(positions), jnp.asarray(_FIRST / 1.5))
    end = rollout.repeat(descend, start, times=steps + 1)
    return PoseSearch(end.positions, end.initial, end.value, _length(hand - arm.forward(end.positions).position))


class _Descent(NamedTuple):
    positions: Joints
    initial: Scalar
    value: Scalar
    slope: Joints
    length: Scalar


def _least(jacobian: Float[Array, "3 joints"], offset: Float[Array, "3"]) -> Joints:
    square = jacobian @ jacobian.T + _DAMPING * jnp.eye(3)
    return jacobian.T @ numerics.solve_square(square, offset[:, None])[:, 0]


def _within_nullspace(jacobian: Float[Array, "3 joints"], motion: Joints, inside: Joints) -> Joints:
    motion, jacobian = motion * inside, jacobian * inside
    return motion - _least(jacobian, jacobian @ motion)


def _is_pushed_out(q: Joints, motion: Joints, ranges: Ranges) -> Array:
    low, high = ranges.T
    return ((q <= low) & (motion < 0.0)) | ((q >= high) & (motion > 0.0))


def _length(vector: Float[Array, " n"]) -> Scalar:
    return numerics.safe_sqrt((vector * vector).sum())
