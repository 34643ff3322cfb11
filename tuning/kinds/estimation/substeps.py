"""How many integration steps a sample takes: chosen by comparison with twice as many, or the study's, checked."""

from __future__ import annotations

import math
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from tuning.files.errors import input_error
from vsajax import Bench, Truth, plants
from vsajax.experiments import estimation

LIMIT = 1024
"""Integration steps a sample beyond which a study is refused: it asks for more than it will ever be given."""
_STABLE = 2.0
"""The splitting is stable for ω h below this."""
_SAFETY = 1.1


@jax.jit
def rate_at_rest(joint: plants.AbstractJoint) -> Float[Array, ""]:
    """Return the fastest elastic rate of a joint at rest [rad/s]."""
    return joint.fastest_rate(joint.observe(joint.rest(), plants.Torques.none()).stiffness)


class Tried(NamedTuple):
    """What a number of integration steps gives.

    Args:
        truth: the bench's motion on one clock.
        rate: the fastest elastic rate on its way, infinite if any is not finite [rad/s].
    """

    truth: Truth
    rate: Float[Array, ""]


@partial(jax.jit, static_argnames="substeps")
def try_substeps(bench: Bench, substeps: int) -> Tried:
    """Return the bench's motion with so many integration steps a sample, and its fastest elastic rate."""
    truth = estimation.simulate(bench, key=jax.random.key(0), substeps=substeps)
    rates = bench.joint.fastest_rate(truth.motion.stiffness)
    return Tried(truth, jnp.max(jnp.where(jnp.isfinite(rates), rates, jnp.inf)))


def choose_substeps(bench: Bench, sample_time: float, tolerance: float) -> int:
    """Return the fewest integration steps a sample found to keep every position within `tolerance` [rad].

    A motion is compared with the one of twice as many steps: the method is of second order, so that 4/3 of their
    largest difference estimates the error.

    Raises:
        InputError: more than `LIMIT` would be needed, or the joint diverges however many there are.
    """
    asked = plants.substeps_for(float(rate_at_rest(bench.joint)), sample_time)
    while True:
        substeps = _allowed(asked, tolerance)
        # The stiffness along the way is only known once simulated; a stiffer moment asks for finer steps.
        coarse, rate = try_substeps(bench, substeps)
        fastest = float(rate)
        if not math.isfinite(fastest):
            # Either the steps are too coarse for the joint's start, or no step is fine enough.
            fastest = float(try_substeps(bench, LIMIT).rate)
            if not math.isfinite(fastest):
                raise input_error(
                    "joint",
                    f"the simulated motion diverges, even with {LIMIT} integration steps a sample",
                    "check its springs, inertias and excitation: is it pushed past where a spring holds?",
                )
        asked = plants.substeps_for(fastest, sample_time)
        if asked > substeps:
            continue
        error = 4.0 / 3.0 * _distance(coarse, try_substeps(bench, 2 * substeps).truth)
        if error <= tolerance:
            return substeps
        asked = max(substeps + 1, math.ceil(substeps * math.sqrt(_SAFETY * error / tolerance)))


def check_substeps(bench: Bench, sample_time: float, substeps: int, tolerance: float) -> None:
    """Refuse a given number of steps with which the integration would be unstable.

    Raises:
        InputError: names the smallest number, and the largest step, that are safe.
    """
    fastest = float(try_substeps(bench, substeps).rate)
    if fastest * sample_time / substeps < _STABLE:
        return
    # What an unstable run says of its own stiffness is garbage: a resolved one tells which step is safe.
    resolved = choose_substeps(bench, sample_time, tolerance)
    step = _STABLE / float(try_substeps(bench, resolved).rate)
    least = math.floor(sample_time / step) + 1
    got = f"got {substeps}: a step of {sample_time / substeps:.3g} s"
    raise input_error(
        "substeps",
        f"{got}, and the integration is unstable above {step:.3g} s",
        f"allowed: at least {least}; without the key the program takes {resolved}",
    )


def _allowed(substeps: int, tolerance: float) -> int:
    if substeps <= LIMIT:
        return substeps
    raise input_error(
        "joint",
        f"asks for about {substeps} integration steps a sample to keep positions within {tolerance:g} rad "
        f"(the limit is {LIMIT})",
        "check inertias and spring rates, shorten clock.sample_time, raise integration_tolerance, or set substeps",
    )


def _distance(first: Truth, second: Truth) -> float:
    names = [name for name in first.motion._fields if name.endswith("_position")]
    pairs = ((getattr(first.motion, name), getattr(second.motion, name)) for name in names)
    return max(float(np.max(np.abs(np.asarray(a) - np.asarray(b)))) for a, b in pairs)
