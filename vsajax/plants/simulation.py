"""Running a joint through a torque recording."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from vsajax import rollout
from vsajax.plants.joints import AbstractJoint, Torques
from vsajax.plants.splitting import MechanicalState, Propagator, propagator, splitting_step

_UNROLLED = 8
"""Steps a sample that are written out; more would make the program long and its compilation slow."""


def simulate(
    joint: AbstractJoint,
    torques: Torques,
    sample_time: Float[Array, "..."],
    *,
    substeps: int,
    midway: Torques | None = None,
    segment: int | None = None,
) -> Any:
    """Integrate a joint from rest and return its motion at every sample.

    Args:
        joint: the plant.
        torques: `(time,)` series at the sampling instants [N·m].
        sample_time: one number for a regular clock, or `(time − 1,)` intervals [s].
        substeps: integration steps a sample; see `substeps_for`.
        midway: `(time, substeps)` torques in the middle of every step, where they are known; else they are
            interpolated linearly between samples (first-order hold), which costs a sine of rate ω at most
            (ω T)²/8 of its amplitude.
        segment: samples a checkpointed segment, see `rollout.scan`.

    Returns:
        What `joint.observe` returns, `(time,)` a field.
    """
    step = sample_time / substeps
    response = propagator(joint.damping_rates(), step, has_friction=joint.friction() is not None)
    is_regular = step.ndim == 0
    if not is_regular:
        # The interval after the last sample leads nowhere; any value does.
        def extend(x: Float[Array, "..."]) -> Float[Array, "..."]:
            full = jnp.broadcast_to(x, step.shape)
            return jnp.concatenate([full, full[-1:]])

        response = jax.tree.map(extend, response)
    if midway is None:
        shares = (jnp.arange(substeps) + 0.5) / substeps

        def interpolate(u: Float[Array, " time"]) -> Float[Array, "time substeps"]:
            following = jnp.concatenate([u[1:], u[-1:]])
            return u[:, None] + shares * (following - u)[:, None]

        midway = jax.tree.map(interpolate, torques)

    def advance(
        state: MechanicalState, inputs: tuple[Torques, Torques, Propagator | None]
    ) -> tuple[MechanicalState, Any]:
        now, between, own_response = inputs
        here = response if own_response is None else own_response
        motion = joint.observe(state, now)

        def one_step(state: MechanicalState, torques: Torques) -> tuple[MechanicalState, None]:
            return splitting_step(state, here, joint.accelerations(torques), joint.friction()), None

        if substeps > _UNROLLED:
            return rollout.scan(one_step, state, between, segment=substeps)[0], motion
        for i in range(substeps):
            state, _ = one_step(state, jax.tree.map(lambda u, i=i: u[i], between))
        return state, motion

    inputs = (torques, midway, None if is_regular else response)
    return rollout.scan(advance, joint.rest(), inputs, segment=segment)[1]
