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
_LONGEST = 0.4
_SHORTEST = 1e-6
_DAMPING = 1e-8


class PoseSearch(NamedTuple):
    """Where a search ended.

    Args:
        positions: q [rad].
        value: of the objective there.
        shift: of the hand from where it was to be [m].
    """

    positions: Joints
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
        positions: where to start, with the hand in place [rad].
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

    def descend(state: tuple[Joints, Scalar, Joints, Scalar]) -> tuple[Joints, Scalar, Joints, Scalar]:
        q, value, slope, length = state
        jacobian = arm.position_jacobian(q)
        along = _within_nullspace(jacobian, -slope, jnp.ones_like(q))
        inside = jnp.where(_is_pushed_out(q, along, ranges), 0.0, 1.0)
        along = _within_nullspace(jacobian, -slope, inside)
        step = length * along * numerics.safe_divide(jnp.ones(()), _length(along))
        tried, shift = reach(arm, q + step, hand, ranges, steps=4)
        new_value, new_slope = both(tried)
        better = (new_value < value) & (shift < _REACHED)
        length = jnp.where(better, jnp.minimum(1.5 * length, _LONGEST), jnp.maximum(length / 3.0, _SHORTEST))
        return (
            jnp.where(better, tried, q),
            jnp.where(better, new_value, value),
            jnp.where(better, new_slope, slope),
            length,
        )

    value, slope = both(positions)
    state = positions, value, slope, jnp.asarray(0.1)
    q, value, _, _ = rollout.repeat(descend, state, times=steps)
    return PoseSearch(q, value, _length(hand - arm.forward(q).position))


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
