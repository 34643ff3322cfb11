"""Joints and torques shared by the plant tests."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from tests.vsajax.builders import SAMPLE_TIME
from vsajax import plants
from vsajax.plants import AbstractJoint, CoulombFriction, FlexibleJoint, LinearSpring, Link, Motion, Motor, Torques


def linear_joint(*, rate: float = 200.0, damping: float = 0.0, motor_damping: float = 0.0) -> FlexibleJoint:
    """Return link 0.1 kg·m² and motor 2.3e-5·50² kg·m² on a linear spring."""
    motor = Motor(2.3e-5, motor_damping, gear_ratio=50.0)
    return FlexibleJoint(Link(0.1, damping), motor, LinearSpring(rate))


def with_friction(joint: plants.SerialJoint) -> plants.SerialJoint:
    """Return the joint with dry friction on every body, resolved by steps of 1 ms."""
    return eqx.tree_at(
        lambda j: (j.link.friction, j.motor.friction, j.setpoint_motor.friction),
        joint,
        (CoulombFriction(1.0, 0.3), CoulombFriction(0.02, 0.3), CoulombFriction(1e-4, 0.5)),
        is_leaf=lambda x: x is None,
    )


def constant_torques(samples: int, motor: float = 0.1, external: float = 5.0) -> Torques:
    """Return torques for which the first-order hold is exact."""
    return Torques(jnp.full(samples, motor), jnp.zeros(samples), jnp.full(samples, external))


def smooth_torques(samples: int) -> Torques:
    """Return slowly varying torques on every input."""
    time = np.arange(samples) * SAMPLE_TIME
    waves = (0.1 + 0.2 * np.sin(20 * time), 4 * np.cos(30 * time), 5 * np.sin(15 * time))
    return Torques(*(jnp.asarray(wave) for wave in waves))


@jax.jit
def simulate_once(joint: AbstractJoint, torques: Torques, step: jax.Array) -> Motion:
    """Simulate with one step a sample; compiled once for all joints of one structure."""
    return plants.simulate(joint, torques, step, substeps=1)


def refined(joint: AbstractJoint, torques: Torques, refinement: int) -> Motion:
    """Simulate with `refinement` steps a sample.

    A finer grid under the interpolated torques is the same problem as substeps, and compiles in a second for any
    refinement; unrolled substeps do not.
    """
    samples = torques.motor.shape[0]
    time = np.arange(samples) * SAMPLE_TIME
    fine = np.linspace(0.0, time[-1], (samples - 1) * refinement + 1)
    held = jax.tree.map(lambda u: jnp.asarray(np.interp(fine, time, u)), torques)
    motion = simulate_once(joint, held, jnp.asarray(SAMPLE_TIME / refinement))
    return jax.tree.map(lambda x: np.asarray(x[::refinement]), motion)
