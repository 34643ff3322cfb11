"""A damping controller whose stiffness is not known but estimated: the command tracked through a serial joint.

The joint's second motor sets a preset γ in [0, 1], and the spring's stiffness is σ(γ) = σ₀ + σ₁γ. To give the
stiffness that the controller asks for, one has to know σ. An estimator in the loop learns it from the elastic
torque; until its answer is known, a nominal law stands in. Everything here is unbatched; users `vmap` it.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Key

from vsajax import rollout
from vsajax.estimators import StiffnessEstimator
from vsajax.experiments.damping import ControlLoop
from vsajax.numerics import dot, safe_divide
from vsajax.plants import SwitchedState
from vsajax.scores.swings import Swept, SwingScorer, SwingScores
from vsajax.types import Command, Sample, Scalar, Series, Swing, as_leaf


class PresetLaw(eqx.Module):
    """σ(γ) = σ₀ + σ₁γ of a preset γ in [0, 1].

    Args:
        base: σ₀ [N·m/rad].
        gain: σ₁ [N·m/rad].
    """

    base: Scalar = eqx.field(converter=as_leaf)
    gain: Scalar = eqx.field(converter=as_leaf)

    def stiffness(self, preset: Scalar) -> Scalar:
        """Return σ [N·m/rad]."""
        return self.base + self.gain * preset

    def preset(self, stiffness: Scalar) -> Scalar:
        """Return the γ of a stiffness, within [0, 1]."""
        return jnp.clip(safe_divide(stiffness - self.base, self.gain), 0.0, 1.0)


class EstimatedLoop(eqx.Module):
    """A loop on one link in which the commanded stiffness goes through an estimate of the spring.

    Args:
        loop: plant, impact, controller, scorer and clock; its actuator's range is that of the true law, and its
            controller is told the true motion.
        law: the true law of the spring.
        nominal: what is believed of it before the estimate is known.
        estimator: of the stiffness, over deflection, preset and measured elastic torque.
        torque_std: noise of the torque sensor [N·m].
        uses_estimate: 1 to follow the estimate once it is known, 0 to believe the nominal law for ever.

    Raises:
        ValueError: the loop has a sensor, which nothing would read.
    """

    loop: ControlLoop
    law: PresetLaw
    nominal: PresetLaw
    estimator: StiffnessEstimator
    torque_std: Scalar = eqx.field(converter=as_leaf)
    uses_estimate: Scalar = eqx.field(converter=as_leaf, default=1.0)

    def __check_init__(self) -> None:
        if self.loop.sensor is not None:
            raise ValueError("an estimated loop tells its controller the true motion: give its loop no sensor")


class EstimatedMotion(NamedTuple):
    """An estimated loop over time.

    Args:
        time: [s].
        position: q [rad].
        stiffness: of the spring [N·m/rad].
        wanted: what the controller asked for [N·m/rad].
        estimate: of the stiffness [N·m/rad].
        known: 1 where the estimate is followed.
    """

    time: Series
    position: Series
    stiffness: Series
    wanted: Series
    estimate: Series
    known: Series


class EstimatedScores(NamedTuple):
    """How a loop came to rest whose stiffness is estimated, and how good the estimate was.

    Args:
        swing: the loop's scores.
        msrep: mean squared relative error of the stiffness where the estimate was followed [%]; NaN if never.
        known_time: when it first was [s]; infinite if never.
    """

    swing: SwingScores
    msrep: Scalar
    known_time: Scalar


class _State(NamedTuple):
    plant: SwitchedState
    controller: Any
    estimator: Any
    believed: PresetLaw


def simulate(joint: EstimatedLoop, *, key: Key[Array, ""]) -> EstimatedMotion:
    """Return the motion of an estimated loop; `key` draws the torque sensor's noise."""
    loop, plant = joint.loop, joint.loop.plant
    if plant.mechanism.joints != 1:
        raise ValueError(f"an estimated loop has one joint; got {plant.mechanism.joints}")
    samples, sample_time = loop.clock.samples, jnp.asarray(loop.clock.sample_time)
    time = jnp.arange(samples) * loop.clock.sample_time
    intervals = jnp.where(jnp.arange(samples) == 0, 0.0, sample_time)
    noise = joint.torque_std * jax.random.normal(key, (samples,))
    zero = jnp.zeros_like(joint.torque_std)
    begin = joint.law.stiffness(joint.nominal.preset(plant.actuator.soft if loop.start is None else loop.start))
    rest = plant.rest(begin)
    rest = rest._replace(velocities=plant.mechanism.kick(rest.positions, loop.impact.impulses(1)))

    def sense(state: SwitchedState, dt: Scalar, drawn: Scalar) -> Sample:
        deflection = state.positions[0] - state.motor_positions[0]
        return Sample(
            dt,
            link_position=state.positions[0],
            motor_position=state.motor_positions[0],
            setpoint_position=joint.law.preset(state.stiffness[0]),
            elastic_torque=state.stiffness[0] * deflection + drawn,
        )

    def step(state: _State, inputs: tuple[Scalar, Scalar, Scalar]) -> tuple[_State, tuple[Scalar, ...]]:
        now, dt, drawn = inputs
        q, v = state.plant.positions[0], state.plant.velocities[0]
        (acceleration,) = plant.accelerations(state.plant, loop.impact.torques(1, now, sample_time))
        swing = Swing(dt, q, v, acceleration, state.plant.motor_positions[0])
        controller, command = loop.controller.step(state.controller, swing)
        sample = sense(state.plant, dt, drawn)
        estimator, answer = joint.estimator.step(state.estimator, sample)
        follows = answer.known & (joint.uses_estimate > 0.5)
        found = _law_of(joint.estimator, estimator, q)
        believed = jax.tree.map(
            lambda new, old: jnp.where(follows & (found.gain > 0.0), new, old), found, state.believed
        )
        asked = Command(joint.law.stiffness(believed.preset(command.stiffness)), command.motor_position)
        moved = plant.step(state.plant, (asked,), loop.impact.torques(1, now, sample_time), sample_time)
        seen = (q, state.plant.stiffness[0], command.stiffness, answer.stiffness, jnp.where(follows, 1.0, zero))
        return _State(moved, controller, estimator, believed), seen

    still = Swing(zero, zero, zero, zero, zero)
    first = sense(rest, zero, zero)
    start = _State(rest, loop.controller.init(still), joint.estimator.init(first), joint.nominal)
    return EstimatedMotion(time, *rollout.scan(step, start, (time, intervals, noise))[1])


def score(joint: EstimatedLoop, *, key: Key[Array, ""]) -> EstimatedScores:
    """Return how an estimated loop came to rest, and how good its estimate was."""
    loop, motion = joint.loop, simulate(joint, key=key)
    velocity = jnp.gradient(motion.position, loop.clock.sample_time)
    actuator = loop.plant.actuator
    return score_estimated(
        loop.scorer,
        motion,
        energy=jax.vmap(lambda q, v: loop.plant.mechanism.energy((q,), (v,)))(motion.position, velocity),
        soft=actuator.soft,
        stiff=actuator.stiff,
        given=motion.stiffness,
        followed=jnp.cumsum(motion.known) > 0.0,
        duration=loop.clock.duration,
    )


@runtime_checkable
class _Motion(Protocol):
    """What the scores read of a motion; arguments as of `EstimatedMotion`."""

    @property
    def time(self) -> Series: ...
    @property
    def position(self) -> Series: ...
    @property
    def wanted(self) -> Series: ...
    @property
    def stiffness(self) -> Series: ...
    @property
    def estimate(self) -> Series: ...


def score_estimated(
    scorer: SwingScorer,
    motion: _Motion,
    *,
    energy: Series,
    soft: Scalar,
    stiff: Scalar,
    given: Series,
    followed: Bool[Array, " time"],
    duration: float,
) -> EstimatedScores:
    """Return the scores of a whole motion, and those of the estimate in it.

    Args:
        scorer: how the motion is judged.
        motion: of the loop.
        energy: of the link, without the spring's [J].
        soft: least stiffness that the controller may ask for [N·m/rad].
        stiff: largest [N·m/rad].
        given: the stiffness that answered what was wanted [N·m/rad].
        followed: where the estimate counts.
        duration: of the motion [s].
    """
    middle, half = 0.5 * (soft + stiff), 0.5 * (stiff - soft)
    swept = Swept(
        motion.time,
        jnp.abs(motion.position),
        energy + 0.5 * middle * motion.position**2,
        ((motion.wanted - middle) / half,),
        ((given - middle) / half,),
    )
    first = scorer.init(jax.tree.map(lambda x: x[0], swept))
    band_energy = 0.5 * middle * scorer.band**2

    def count(state: Any, one: Swept) -> tuple[Any, None]:
        return scorer.step(state, one, band_energy=band_energy, duration=duration), None

    swing = scorer.scores(rollout.scan(count, first, swept)[0], duration=duration)
    relative = (motion.stiffness - motion.estimate) / motion.stiffness
    number = jnp.sum(followed)
    msrep = 100.0 * jnp.sum(jnp.where(followed, relative**2, 0.0)) / jnp.where(number > 0, number, jnp.nan)
    return EstimatedScores(swing, msrep, jnp.min(jnp.where(followed, motion.time, jnp.inf)))


def _law_of(estimator: StiffnessEstimator, state: Any, deflection: Float[Array, ""]) -> PresetLaw:
    """Return the law that an estimator has fitted, from both ends of the preset."""
    ends = [
        dot(estimator.basis(jnp.full_like(deflection, preset), deflection)[1], state.fit.coefficients)
        for preset in (0.0, 1.0)
    ]
    return PresetLaw(ends[0], ends[1] - ends[0])
