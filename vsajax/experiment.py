"""The one pure function of the lab, simulate -> measure -> estimate -> score, and the bench that feeds it.

This is the only module that knows plants and estimators. Everything here is unbatched; users `vmap` it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Key

from vsajax import plants, rollout
from vsajax.estimators import AbstractEstimator, StiffnessEstimator
from vsajax.estimators.lag import LagState, lagged, start_lag
from vsajax.metrics import Scorer, Scores, ScoreState
from vsajax.plants import AbstractJoint, Torques
from vsajax.sensing import Clock, Excitation, SensorSuite
from vsajax.types import Estimate, Recording, Scalar, Series


class Bench(eqx.Module):
    """A joint on the test bench, with what drives it, what measures it and what estimates its stiffness.

    Its array leaves are everything that can be varied: across a population by `vmap`, across a grid by nested
    `vmap`, along a gradient by differentiation.
    """

    joint: AbstractJoint
    excitation: Excitation
    sensing: SensorSuite
    estimator: AbstractEstimator
    scorer: Scorer
    clock: Clock


class Truth(NamedTuple):
    """A simulated motion, as the joint's `observe` returns it, and when it was sampled [s]."""

    time: Series
    motion: Any


def simulate(bench: Bench, *, key: Key[Array, ""], substeps: int) -> Truth:
    """Return the motion of the bench's joint under its excitation.

    Args:
        bench: only joint, excitation and clock are used.
        key: of the clock's jitter.
        substeps: integration steps a sample, see `plants.substeps_for`.
    """
    time = bench.clock.times(key=key)
    intervals = bench.clock.intervals(time)
    # The step after the last sample leads nowhere; its torques may be any.
    steps = jnp.concatenate([jnp.diff(time), jnp.diff(time)[-1:]])
    middles = time[:, None] + steps[:, None] * (jnp.arange(substeps) + 0.5) / substeps
    motion = plants.simulate(
        bench.joint,
        Torques(*bench.excitation.torques(time)),
        intervals,
        substeps=substeps,
        midway=Torques(*bench.excitation.torques(middles)),
    )
    return Truth(time, motion)


def measure(bench: Bench, truth: Truth, *, key: Key[Array, ""]) -> Recording:
    """Return what the bench's sensors record of a motion; `key` draws the noise."""
    return bench.sensing.measure(truth.time, truth.motion, key=key)


def estimate(estimator: AbstractEstimator, recording: Recording, *, segment: int | None = None) -> Estimate:
    """Run an estimator over a recording, simulated or real.

    Args:
        estimator: any estimator.
        recording: `(time,)` signals.
        segment: samples a checkpointed segment, see `rollout.scan`.

    Returns:
        The estimates, `(time,)` a field.

    Raises:
        MissingSignalError: the recording lacks a signal that the estimator needs.
        PrecisionError: double precision is off.
    """
    prepared = estimator.offline(recording.samples())
    return rollout.scan(prepared.step, prepared.state, prepared.inputs, segment=segment)[1]


def score(estimator: AbstractEstimator, recording: Recording, stiffness: Series, *, scorer: Scorer) -> Scores:
    """Run an estimator over a recording and score it against the true stiffness, in constant memory.

    Args:
        estimator: any estimator.
        recording: `(time,)` signals.
        stiffness: the true stiffness at the same instants [N·m/rad].
        scorer: what to count.
    """
    prepared = estimator.offline(recording.samples())

    def step(state: tuple[Any, ScoreState], inputs: tuple[Any, Scalar, Scalar]) -> tuple[Any, None]:
        running, counted = state
        one, time, true_stiffness = inputs
        running, answer = prepared.step(running, one)
        return (running, scorer.step(counted, time, true_stiffness, answer)), None

    start, inputs = (prepared.state, scorer.init()), (prepared.inputs, recording.time, stiffness)
    return scorer.scores(rollout.scan(step, start, inputs)[0][1])


def score_estimate(time: Series, stiffness: Series, answer: Estimate, *, scorer: Scorer) -> Scores:
    """Score estimates that were already computed, e.g. read from a file."""

    def step(state: ScoreState, inputs: tuple[Scalar, Scalar, Estimate]) -> tuple[ScoreState, None]:
        return scorer.step(state, *inputs), None

    return scorer.scores(rollout.scan(step, scorer.init(), (time, stiffness, answer))[0])


def residuals(
    estimator: AbstractEstimator,
    recording: Recording,
    stiffness: Series,
    *,
    scorer: Scorer,
    settled: bool = False,
) -> Float[Array, " time"]:
    """Return the vector whose squared norm is the recording's MSREP [√%], for least-squares tuning.

    Element k is 10 (σ − σ̂)/σ / √p, with p as in (36); with `settled`, 0 before the scorer's warm-up time.
    """
    answer = estimate(estimator, recording)
    counts = jnp.abs(stiffness) > scorer.stiffness_floor
    if settled:
        counts = counts & (recording.time >= scorer.warm_up)
    relative = jnp.where(counts, scorer.relative_error(stiffness, answer.stiffness), 0.0)
    return 10.0 * relative / jnp.sqrt(jnp.sum(counts) - 1.0)


def agreement(estimator: StiffnessEstimator, recording: Recording) -> tuple[Series, Series]:
    """Return the torque that the fit is to explain [N·m], and the deflection, lagging as much as the torque [rad].

    A residual observer's torque is the elastic torque through a lag: held against the deflection itself, a spring
    looks like a damper.
    """
    signals, gain = estimate(estimator, recording).signals, estimator.torque.lag
    if gain is None:
        return signals.torque, signals.deflection

    def step(state: LagState, inputs: tuple[Scalar, Scalar]) -> tuple[LagState, Scalar]:
        deflection, dt = inputs
        outputs = lagged(state, (deflection,), gain, dt)
        return LagState(outputs, (deflection,)), outputs[0]

    inputs = (signals.deflection, recording.samples().dt)
    return signals.torque, rollout.scan(step, start_lag((signals.deflection[0],)), inputs)[1]
