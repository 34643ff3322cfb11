"""Controllers in the loop: plant -> sensor -> observer -> controller -> actuators -> plant, and how it is scored.

The same sentence as `experiment`, with a controller in the estimator's place::

    score = metric(simulate(plant, controller, impact))

This module knows plants and controllers. Everything here is unbatched; users `vmap` it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Key

from vsajax import rollout, showing
from vsajax.control import AbstractController, SwingObserver
from vsajax.numerics import safe_sqrt
from vsajax.plants import SwitchedPlant, SwitchedState
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


class _Run(NamedTuple):
    """A closed loop made ready for a scan."""

    state: LoopState
    inputs: Any
    step: Callable[[LoopState, Any], tuple[LoopState, tuple[Command, ...]]]
    sense: Callable[[LoopState, Any], tuple[tuple[Any, ...], tuple[Any, ...], tuple[Swing, ...]]]


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
    run = _prepare(loop, key, substeps)

    def step(state: LoopState, inputs: Any) -> tuple[LoopState, Any]:
        after, commands = run.step(state, inputs)
        plant = state.plant
        return after, (*plant, tuple(command.stiffness for command in commands))

    seen = rollout.scan(step, run.state, run.inputs, segment=segment)[1]
    return SwingMotion(run.inputs[0], *seen)


def exchanges(loop: ControlLoop, *, key: Key[Array, ""], substeps: int = 2) -> tuple[Exchange, ...]:
    """Return what every joint's controller was told and what it answered; arguments as of `simulate`."""
    run = _prepare(loop, key, substeps)

    def step(state: LoopState, inputs: Any) -> tuple[LoopState, Any]:
        after, commands = run.step(state, inputs)
        return after, (run.sense(state, inputs)[2], commands)

    swings, commands = rollout.scan(step, run.state, run.inputs)[1]
    return tuple(
        Exchange(Recording(run.inputs[0], swing.position, swing.motor_position), command)
        for swing, command in zip(swings, commands, strict=True)
    )


def score(loop: ControlLoop, *, key: Key[Array, ""], substeps: int = 2) -> SwingScores:
    """Return the scores of a closed loop without keeping its motion."""
    run, scorer, duration = _prepare(loop, key, substeps), loop.scorer, loop.clock.duration
    band_energy = _band_energy(loop)

    def step(both: tuple[LoopState, Any], inputs: Any) -> tuple[tuple[LoopState, Any], None]:
        state, counted = both
        after, commands = run.step(state, inputs)
        swept = _swept(loop, inputs[0], state.plant, commands)
        return (after, scorer.step(counted, swept, band_energy=band_energy, duration=duration)), None

    still = tuple(
        Command(k, m) for k, m in zip(run.state.plant.stiffness, run.state.plant.motor_positions, strict=True)
    )
    first = scorer.init(_swept(loop, run.inputs[0][0], run.state.plant, still))
    counted = rollout.scan(step, (run.state, first), run.inputs)[0][1]
    return scorer.scores(counted, duration=duration)


def residuals(loop: ControlLoop, *, key: Key[Array, ""], substeps: int = 2) -> Float[Array, " time"]:
    """Return the vector whose squared norm is the score `log_energy`, for least-squares tuning."""
    run, band_energy = _prepare(loop, key, substeps), _band_energy(loop)

    def step(state: LoopState, inputs: Any) -> tuple[LoopState, Scalar]:
        after, _ = run.step(state, inputs)
        return after, safe_sqrt(jnp.log1p(loop.plant.energy(state.plant, _middle(loop)) / band_energy))

    each = rollout.scan(step, run.state, run.inputs)[1]
    return each / jnp.sqrt(float(each.shape[0]))


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


def _prepare(loop: ControlLoop, key: Key[Array, ""], substeps: int) -> _Run:
    plant, controller, sensor = loop.plant, loop.controller, loop.sensor
    joints, sample_time = plant.mechanism.joints, jnp.asarray(loop.clock.sample_time)
    time = jnp.arange(loop.clock.samples) * loop.clock.sample_time
    intervals = jnp.where(jnp.arange(loop.clock.samples) == 0, 0.0, sample_time)
    noise = None
    if sensor is not None and sensor.noise_std is not None:
        noise = jax.random.normal(key, (loop.clock.samples, joints))
    zero = jnp.zeros_like(plant.actuator.soft)
    still = Swing(zero, zero, zero, zero, zero)
    state = controller.init(still)
    standing = controller.step(state, still)[1].stiffness if loop.start is None else loop.start
    at_rest = plant.rest(plant.actuator.after(zero, standing, zero + jnp.inf))
    kicked = plant.mechanism.kick(at_rest.positions, loop.impact.impulses(joints))
    start = LoopState(
        at_rest._replace(velocities=tuple(v + zero for v in kicked)),
        (None if sensor is None else sensor.init(zero),) * joints,
        (None if sensor is None else loop.observer.init(zero),) * joints,
        (state,) * joints,
    )

    def joint(state: LoopState, i: int, dt: Scalar, drawn: Any, accelerations: Any) -> tuple[Any, Any, Swing]:
        position, motor = state.plant.positions[i], state.plant.motor_positions[i]
        if sensor is None:
            return None, None, Swing(dt, position, state.plant.velocities[i], accelerations[i], motor)
        own, reading = sensor.step(state.sensors[i], position, None if drawn is None else drawn[i], sample_time)
        observer, swing = loop.observer.step(state.observers[i], reading, motor, dt)
        return own, observer, swing

    def sense(state: LoopState, inputs: Any) -> tuple[tuple[Any, ...], tuple[Any, ...], tuple[Swing, ...]]:
        now, dt, drawn = inputs
        accelerations = plant.accelerations(state.plant, loop.impact.torques(joints, now, sample_time))
        each = [joint(state, i, dt, drawn, accelerations) for i in range(joints)]
        sensors, observers, swings = zip(*each, strict=True)
        return sensors, observers, swings

    def step(state: LoopState, inputs: Any) -> tuple[LoopState, tuple[Command, ...]]:
        now = inputs[0]
        sensors, observers, swings = sense(state, inputs)
        pairs = [controller.step(own, swing) for own, swing in zip(state.controllers, swings, strict=True)]
        controllers, commands = zip(*pairs, strict=True)
        moved, small = state.plant, sample_time / substeps
        for i in range(substeps):
            torques = loop.impact.torques(joints, now + i * small, small)
            moved = plant.step(moved, commands, torques, small)
        return LoopState(moved, sensors, observers, controllers), commands

    return _Run(start, (time, intervals, noise), step, sense)
