"""The one pure function of the lab, simulate -> measure -> estimate -> score, and the bench that feeds it.

Everything here is unbatched; users `vmap` it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Key

from vsajax import guard, plants, rollout, showing
from vsajax.estimators import AbstractEstimator, StiffnessEstimator
from vsajax.estimators.lag import LagState, lagged, start_lag
from vsajax.plants import AbstractJoint, Torques
from vsajax.rollout import sensitivity
from vsajax.scores.estimates import Scorer, Scores, ScoreState
from vsajax.sensing import Clock, Excitation, SensorSuite
from vsajax.types import Estimate, Recording, Sample, Scalar, Series


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

    _repr_html_ = showing.to_html
    to_pandas = showing.to_pandas
    plot = showing.plot


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

    A sample with a reading or a time that is no number, or with a reading that has jumped, is left out, as
    `guard.Guarded` does it on a robot.

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
    sound = guard.are_taken(recording)
    order = jnp.argsort(~sound, stable=True)
    # The sound samples come first; the last of them fills the rest, whose answers nobody reads.
    last = order[jnp.sum(sound) - 1]
    kept = jax.tree.map(lambda x: x[jnp.where(sound[order], order, last)], recording)
    prepared = estimator.offline(kept.samples())
    answers = rollout.scan(prepared.step, prepared.state, prepared.inputs, segment=segment)[1]
    first = jax.tree.map(lambda x: x[0], recording.samples())
    return guard.given_again(answers, sound, guard.Guarded(estimator).init(first).answer)


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


class Observed(NamedTuple):
    """A recording made ready for least-squares tuning, `(time,)` a signal.

    Args:
        samples: as `Recording.samples` gives them.
        time: of the samples [s].
        stiffness: the true stiffness [N·m/rad].
        start: errors count from this time [s].
        scale: 10/√p with p as in (36), for which the squares of the relative errors sum to the MSREP [%].
    """

    samples: Sample
    time: Series
    stiffness: Series
    start: Scalar
    scale: Scalar


def observe(recording: Recording, stiffness: Series, *, scorer: Scorer, settled: bool = False) -> Observed:
    """Return a recording made ready for tuning against its true stiffness [N·m/rad].

    With `settled`, errors before the scorer's warm-up time do not count.
    """
    start = scorer.warm_up if settled else jnp.full_like(scorer.warm_up, -jnp.inf)
    counted = jnp.sum((jnp.abs(stiffness) > scorer.stiffness_floor) & (recording.time >= start))
    return Observed(recording.samples(), recording.time, stiffness, start, 10.0 / jnp.sqrt(counted - 1.0))


class ResidualStep(eqx.Module):
    """An estimator's step that returns the relative error of its stiffness, scaled.

    Args:
        step: (state, input) -> (state, estimate).
        scorer: what a relative error is.
        start: errors count from this time [s].
        scale: what they are multiplied by.
    """

    step: Callable[[Any, Any], tuple[Any, Estimate]]
    scorer: Scorer
    start: Scalar
    scale: Scalar

    def __call__(self, state: Any, sample: tuple[Any, Scalar, Scalar]) -> tuple[Any, Scalar]:
        """Process an input at a time, with its true stiffness."""
        inputs, time, stiffness = sample
        state, answer = self.step(state, inputs)
        relative = self.scorer.relative_error(stiffness, answer.stiffness)
        return state, jnp.where(time >= self.start, self.scale * relative, 0.0)


def residual_loop(estimator: AbstractEstimator, observed: Observed, *, scorer: Scorer) -> sensitivity.Loop:
    """Return the loop over residuals 10 (σ − σ̂)/σ / √p, whose squares sum to the MSREP [%].

    `sensitivity.run` gives them all, `sensitivity.normal_equations` what Gauss–Newton needs of them.
    """
    prepared = estimator.offline(observed.samples)
    step = ResidualStep(prepared.step, scorer, observed.start, observed.scale)
    return sensitivity.Loop(step, prepared.state, (prepared.inputs, observed.time, observed.stiffness))


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
        state = lagged(state, deflection[None], gain, dt)
        return state, state.outputs[0]

    inputs = (signals.deflection, recording.samples().dt)
    return signals.torque, rollout.scan(step, start_lag(signals.deflection[:1]), inputs)[1]
