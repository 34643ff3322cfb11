"""Controllers in the loop: plant -> sensor -> observer -> controller -> actuators -> plant, and how it is scored.

The same sentence as `experiments.estimation`, with a controller in the estimator's place::

    score = metric(simulate(plant, controller, impact))

Everything here is unbatched; users `vmap` it.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Key

from vsajax import rollout, showing
from vsajax.control import AbstractController, SwingObserver
from vsajax.numerics import safe_sqrt
from vsajax.plants import SwitchedPlant, SwitchedState
from vsajax.rollout import sensitivity
from vsajax.scores.swings import Swept, SwingScorer, SwingScores
from vsajax.sensing import Clock, FeedbackSensor, Impact
from vsajax.types import Command, Recording, Scalar, Series, Swing, optional_leaf

Vectors = tuple[Series, ...]


class ControlLoop(eqx.Module):
    """A plant that is hit, and what brings it to rest.

    Its array leaves are everything that can be varied, as those of a `Bench`.

    Args:
        plant: the joints and their actuators.
        impact: what sets them swinging at time 0.
        controller: of every joint; each joint has its own state.
        scorer: how the motion is judged.
        clock: of the controller; regular.
        sensor: of the link positions; `None` gives the controller the true motion.
        observer: how velocities are found from readings; unused without a sensor.
        start: stiffness at which the impact finds the joints [N·m/rad]; `None` is where the controller has them
            while nothing moves.
    """

    plant: SwitchedPlant
    impact: Impact
    controller: AbstractController
    scorer: SwingScorer
    clock: Clock
    sensor: FeedbackSensor | None = None
    observer: SwingObserver = eqx.field(default_factory=SwingObserver)
    start: Scalar | None = eqx.field(converter=optional_leaf, default=None)


class SwingMotion(NamedTuple):
    """A closed loop over time: one `(time,)` series a joint.

    Args:
        time: [s].
        positions: q [rad].
        velocities: q̇ [rad/s].
        stiffness: of the springs [N·m/rad].
        motor_positions: θ [rad].
        commanded: stiffness asked for at that instant [N·m/rad].
    """

    time: Series
    positions: Vectors
    velocities: Vectors
    stiffness: Vectors
    motor_positions: Vectors
    commanded: Vectors

    _repr_html_ = showing.to_html
    to_pandas = showing.to_pandas
    plot = showing.plot


class Exchange(NamedTuple):
    """What one joint's controller was told over time, and what it answered.

    Args:
        recording: the link's reading, or its true position without a sensor, and the motor position.
        commands: at the same instants.
    """

    recording: Recording
    commands: Command


class LoopState(NamedTuple):
    """The plant, and each joint's sensor, observer and controller."""

    plant: SwitchedState
    sensors: tuple[Any, ...]
    observers: tuple[Any, ...]
    controllers: tuple[Any, ...]


class Inputs(NamedTuple):
    """What the samples of a closed loop differ by.

    Args:
        time: [s].
        interval: since the sample before, 0 at the first [s].
        noise: standard normal, one a joint, or `None` where no sensor has noise.
    """

    time: Scalar
    interval: Scalar
    noise: Float[Array, " joints"] | None


class ClosedStep(eqx.Module):
    """One sample of a closed loop: what is read, what is answered, where the plant then is.

    Args:
        loop: what runs.
        substeps: Runge–Kutta steps a sample.
    """

    loop: ControlLoop
    substeps: int = eqx.field(static=True, default=2)

    def init(self) -> LoopState:
        """Return the loop as the impact leaves it at time 0."""
        loop, plant = self.loop, self.loop.plant
        joints, zero = plant.mechanism.joints, jnp.zeros_like(plant.actuator.soft)
        still = Swing(zero, zero, zero, zero, zero)
        state = loop.controller.init(still)
        standing = loop.controller.step(state, still)[1].stiffness if loop.start is None else loop.start
        at_rest = plant.rest(plant.actuator.after(zero, standing, zero + jnp.inf))
        kicked = plant.mechanism.kick(at_rest.positions, loop.impact.impulses(joints))
        return LoopState(
            at_rest._replace(velocities=tuple(v + zero for v in kicked)),
            (None if loop.sensor is None else loop.sensor.init(zero),) * joints,
            (None if loop.sensor is None else loop.observer.init(zero),) * joints,
            (state,) * joints,
        )

    def inputs(self, key: Key[Array, ""]) -> Inputs:
        """Return what the samples differ by; `key` draws the sensors' noise."""
        clock, sensor = self.loop.clock, self.loop.sensor
        number = jnp.arange(clock.samples)
        noise = None
        if sensor is not None and sensor.noise_std is not None:
            noise = jax.random.normal(key, (clock.samples, self.loop.plant.mechanism.joints))
        return Inputs(
            number * clock.sample_time, jnp.where(number == 0, 0.0, jnp.asarray(clock.sample_time)), noise
        )

    def sense(self, state: LoopState, now: Inputs) -> tuple[tuple[Any, ...], tuple[Any, ...], tuple[Swing, ...]]:
        """Return every joint's sensor and observer after a reading, and what its controller is told."""
        plant, sample_time = self.loop.plant, jnp.asarray(self.loop.clock.sample_time)
        joints = plant.mechanism.joints
        accelerations = plant.accelerations(state.plant, self.loop.impact.torques(joints, now.time, sample_time))
        each = [self._joint(state, i, now, accelerations) for i in range(joints)]
        sensors, observers, swings = zip(*each, strict=True)
        return sensors, observers, swings

    def _joint(self, state: LoopState, i: int, now: Inputs, accelerations: Any) -> tuple[Any, Any, Swing]:
        loop, position, motor = self.loop, state.plant.positions[i], state.plant.motor_positions[i]
        if loop.sensor is None:
            return None, None, Swing(now.interval, position, state.plant.velocities[i], accelerations[i], motor)
        drawn = None if now.noise is None else now.noise[i]
        own, reading = loop.sensor.step(state.sensors[i], position, drawn, jnp.asarray(loop.clock.sample_time))
        observer, swing = loop.observer.step(state.observers[i], reading, motor, now.interval)
        return own, observer, swing

    def __call__(self, state: LoopState, now: Inputs) -> tuple[LoopState, tuple[Command, ...]]:
        """Return the loop a sample later, and what its controllers answered."""
        loop, joints = self.loop, self.loop.plant.mechanism.joints
        sensors, observers, swings = self.sense(state, now)
        pairs = [loop.controller.step(own, swing) for own, swing in zip(state.controllers, swings, strict=True)]
        controllers, commands = zip(*pairs, strict=True)
        moved, small = state.plant, jnp.asarray(loop.clock.sample_time) / self.substeps
        for i in range(self.substeps):
            torques = loop.impact.torques(joints, now.time + i * small, small)
            moved = loop.plant.step(moved, commands, torques, small)
        return LoopState(moved, sensors, observers, controllers), commands


class ResidualStep(eqx.Module):
    """A closed loop's step that returns the root of the score `log_energy` there, scaled.

    Args:
        step: of the closed loop.
        scale: 1/√n of n samples.
    """

    step: ClosedStep
    scale: float = eqx.field(static=True)

    def __call__(self, state: LoopState, now: Inputs) -> tuple[LoopState, Scalar]:
        """Process a sample."""
        loop = self.step.loop
        energy = loop.plant.energy(state.plant, _middle(loop)) / _band_energy(loop)
        return self.step(state, now)[0], self.scale * safe_sqrt(jnp.log1p(energy))


def simulate(
    loop: ControlLoop, *, key: Key[Array, ""], substeps: int = 2, segment: int | None = None
) -> SwingMotion:
    """Return the motion of a closed loop.

    Args:
        loop: what is simulated.
        key: of the sensors' noise.
        substeps: Runge–Kutta steps a sample.
        segment: samples a checkpointed segment, see `rollout.scan`.
    """
    closed = ClosedStep(loop, substeps)
    inputs = closed.inputs(key)

    def step(state: LoopState, now: Inputs) -> tuple[LoopState, Any]:
        after, commands = closed(state, now)
        return after, (*state.plant, tuple(command.stiffness for command in commands))

    seen = rollout.scan(step, closed.init(), inputs, segment=segment)[1]
    return SwingMotion(inputs.time, *seen)


def exchanges(loop: ControlLoop, *, key: Key[Array, ""], substeps: int = 2) -> tuple[Exchange, ...]:
    """Return what every joint's controller was told and what it answered; arguments as of `simulate`."""
    closed = ClosedStep(loop, substeps)
    inputs = closed.inputs(key)

    def step(state: LoopState, now: Inputs) -> tuple[LoopState, Any]:
        after, commands = closed(state, now)
        return after, (closed.sense(state, now)[2], commands)

    swings, commands = rollout.scan(step, closed.init(), inputs)[1]
    return tuple(
        Exchange(Recording(inputs.time, swing.position, swing.motor_position), command)
        for swing, command in zip(swings, commands, strict=True)
    )


def score(loop: ControlLoop, *, key: Key[Array, ""], substeps: int = 2) -> SwingScores:
    """Return the scores of a closed loop without keeping its motion."""
    closed, scorer, duration = ClosedStep(loop, substeps), loop.scorer, loop.clock.duration
    start, inputs, band_energy = closed.init(), closed.inputs(key), _band_energy(loop)

    def step(both: tuple[LoopState, Any], now: Inputs) -> tuple[tuple[LoopState, Any], None]:
        state, counted = both
        after, commands = closed(state, now)
        swept = _swept(loop, now.time, state.plant, commands)
        return (after, scorer.step(counted, swept, band_energy=band_energy, duration=duration)), None

    still = tuple(Command(k, m) for k, m in zip(start.plant.stiffness, start.plant.motor_positions, strict=True))
    first = scorer.init(_swept(loop, inputs.time[0], start.plant, still))
    counted = rollout.scan(step, (start, first), inputs)[0][1]
    return scorer.scores(counted, duration=duration)


def residual_loop(loop: ControlLoop, *, key: Key[Array, ""], substeps: int = 2) -> sensitivity.Loop:
    """Return the loop over residuals whose squares sum to the score `log_energy`, for least-squares tuning."""
    closed = ClosedStep(loop, substeps)
    return sensitivity.Loop(
        ResidualStep(closed, 1.0 / math.sqrt(loop.clock.samples)), closed.init(), closed.inputs(key)
    )


def energies(loop: ControlLoop, motion: SwingMotion, stiffness: Scalar) -> Series:
    """Return the energy over time with every spring at `stiffness` [J]: V of (24) for k_min."""

    def energy(*state: tuple[Scalar, ...]) -> Scalar:
        return loop.plant.energy(SwitchedState(*state), stiffness)

    return jax.vmap(energy)(motion.positions, motion.velocities, motion.stiffness, motion.motor_positions)


def _middle(loop: ControlLoop) -> Scalar:
    return 0.5 * (loop.plant.actuator.soft + loop.plant.actuator.stiff)


def _band_energy(loop: ControlLoop) -> Scalar:
    return 0.5 * _middle(loop) * loop.scorer.band**2


def _swept(loop: ControlLoop, time: Scalar, plant: SwitchedState, commands: tuple[Command, ...]) -> Swept:
    middle = _middle(loop)
    half = loop.plant.actuator.stiff - middle

    def place(stiffness: Scalar) -> Scalar:
        return (stiffness - middle) / half

    excursion = jnp.abs(plant.positions[0])
    for position in plant.positions[1:]:
        excursion = jnp.maximum(excursion, jnp.abs(position))
    return Swept(
        time,
        excursion,
        loop.plant.energy(plant, middle),
        tuple(place(command.stiffness) for command in commands),
        tuple(place(stiffness) for stiffness in plant.stiffness),
    )
