"""Running a joint through a torque recording."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from vsajax import rollout
from vsajax.plants.joints import AbstractJoint, Motion, Torques
from vsajax.plants.splitting import MechanicalState, Propagator, propagator, splitting_step


def simulate(
    joint: AbstractJoint,
    torques: Torques,
    sample_time: Float[Array, "..."],
    *,
    substeps: int,
    segment: int | None = None,
) -> Motion:
    """Integrate a joint from rest and return its motion at every sample.

    Between samples the torques are interpolated linearly (first-order hold).

    Args:
        joint: the plant.
        torques: `(time,)` series at the sampling instants [N·m].
        sample_time: one number for a regular clock, or `(time − 1,)` intervals [s].
        substeps: integration steps a sample; see `substeps_for`.
        segment: samples a checkpointed segment, see `rollout.scan`.

    Returns:
        The motion, `(time,)` a field.
    """
    step = sample_time / substeps
    response = propagator(joint.damping_rates(), step, has_friction=joint.friction() is not None)
    following = jax.tree.map(lambda u: jnp.concatenate([u[1:], u[-1:]]), torques)
    is_regular = step.ndim == 0
    if not is_regular:
        # The interval after the last sample leads nowhere; any value does.
        def extend(x: Float[Array, "..."]) -> Float[Array, "..."]:
            full = jnp.broadcast_to(x, step.shape)
            return jnp.concatenate([full, full[-1:]])

        response = jax.tree.map(extend, response)

    def advance(
        state: MechanicalState, inputs: tuple[Torques, Torques, Propagator | None]
    ) -> tuple[MechanicalState, Motion]:
        now, then, own_response = inputs
        here = response if own_response is None else own_response
        motion = joint.observe(state, now)
        for i in range(substeps):
            share = (i + 0.5) / substeps
            middle = jax.tree.map(lambda a, b, share=share: a + share * (b - a), now, then)
            state = splitting_step(state, here, joint.accelerations(middle), joint.friction())
        return state, motion

    inputs = (torques, following, None if is_regular else response)
    return rollout.scan(advance, joint.rest(), inputs, segment=segment)[1]
