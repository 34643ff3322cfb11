"""A damping controller on an agonist-antagonist joint: co-contraction sets the stiffness, by estimated springs.

The joint is the one of `plants`: two motors pull the link through nonlinear springs, and how far they pull apart
sets how stiff it is. To give the stiffness that a controller asks for one has to know both springs. A pair of
estimators in the loop learns them from motor torques and positions alone; until both are known, springs that are
merely believed stand in. Everything here is unbatched; users `vmap` it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Key

from vsajax import rollout
from vsajax.control import AbstractController
from vsajax.estimators import AntagonisticPair, ResidualTorque, StiffnessEstimator
from vsajax.experiments.estimated_damping import EstimatedScores, score_estimated
from vsajax.numerics import dot
from vsajax.plants import AbstractSpring, AntagonisticJoint, Torques
from vsajax.plants.splitting import MechanicalState, propagator, splitting_step
from vsajax.scores.swings import SwingScorer
from vsajax.sensing import Clock, Impact
from vsajax.types import Sample, Scalar, Series, Swing, as_leaf

_HALVINGS = 16


class PositionServo(eqx.Module):
    """The fast inner loop of a motor drive, τ = Kp (θ* − θ) − Kd θ̇.

    Args:
        proportional: Kp [N·m/rad].
        derivative: Kd [N·m·s/rad].
    """

    proportional: Scalar = eqx.field(converter=as_leaf)
    derivative: Scalar = eqx.field(converter=as_leaf)

    def torque(self, target: Scalar, position: Scalar, velocity: Scalar) -> Scalar:
        """Return the motor torque [N·m]."""
        return self.proportional * (target - position) - self.derivative * velocity


class AntagonisticLoop(eqx.Module):
    """A controlled antagonistic joint that is hit.

    Its motors stand at ±δ. The stiffness that a controller asks for is that of the undeflected joint,
    σ₁(−δ) + σ₂(δ): springs that stiffen make it larger the further the link is out.

    Args:
        joint: the plant; its springs are the true ones.
        servo: of both motors; it runs at the integration step.
        controller: asks for a stiffness; the motors' mean stays at 0.
        impact: an impulse on the link at time 0.
        scorer: how the motion is judged.
        clock: of the controller and the estimators; regular.
        estimator: of both springs; its sides are `StiffnessEstimator`s on a `ResidualTorque`.
        believed1: the first spring, as believed before it is known.
        believed2: the second spring.
        soft: smallest stiffness that is asked for [N·m/rad].
        stiff: largest [N·m/rad]; the energy of the scores is that of a spring halfway between.
        start: stiffness at which the impact finds the joint, as believed [N·m/rad].
        reach: largest δ [rad].
        speed: of the motors' way from one δ to another [rad/s].
        torque_std: noise of the motor torques [N·m].
        uses_estimate: 1 to follow the estimate once both sides are known, 0 never to.
    """

    joint: AntagonisticJoint
    servo: PositionServo
    controller: AbstractController
    impact: Impact
    scorer: SwingScorer
    clock: Clock
    estimator: AntagonisticPair
    believed1: AbstractSpring
    believed2: AbstractSpring
    soft: Scalar = eqx.field(converter=as_leaf)
    stiff: Scalar = eqx.field(converter=as_leaf)
    start: Scalar = eqx.field(converter=as_leaf)
    reach: Scalar = eqx.field(converter=as_leaf, default=0.8)
    speed: Scalar = eqx.field(converter=as_leaf, default=6.0)
    torque_std: Scalar = eqx.field(converter=as_leaf, default=0.0)
    uses_estimate: Scalar = eqx.field(converter=as_leaf, default=1.0)

    def __check_init__(self):
        """Refuse estimators whose springs cannot be read off."""
        for side in self.estimator.both:
            if not (isinstance(side, StiffnessEstimator) and isinstance(side.torque, ResidualTorque)):
                raise TypeError(f"both sides must be StiffnessEstimators on a ResidualTorque; got {side}")


class CoContractedMotion(NamedTuple):
    """An antagonistic loop over time.

    Args:
        time: [s].
        position: q of the link [rad].
        velocity: of the link [rad/s].
        contraction: δ, half of what the motors stand apart [rad].
        wanted: what the controller asked for [N·m/rad].
        given: of the undeflected joint at this contraction [N·m/rad].
        stiffness: of the joint where it is [N·m/rad].
        estimate: of the same [N·m/rad].
        known: 1 where the estimate is followed.
    """

    time: Series
    position: Series
    velocity: Series
    contraction: Series
    wanted: Series
    given: Series
    stiffness: Series
    estimate: Series
    known: Series


class _State(NamedTuple):
    mechanics: MechanicalState
    torques: tuple[Scalar, Scalar]
    controller: Any
    estimator: Any
    contraction: Scalar


def contraction(stiffness_at: Callable[[Scalar], Scalar], wanted: Scalar, reach: Scalar) -> Scalar:
    """Return the δ in [0, reach] at which an undeflected joint has a stiffness that grows with δ [rad]."""

    def halve(ends: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
        low, high = ends
        middle = 0.5 * (low + high)
        is_low = stiffness_at(middle) < wanted
        return jnp.where(is_low, middle, low), jnp.where(is_low, high, middle)

    whole = (jnp.zeros_like(wanted), reach + jnp.zeros_like(wanted))
    low, high = rollout.repeat(halve, whole, times=_HALVINGS)
    return 0.5 * (low + high)


def simulate(loop: AntagonisticLoop, *, key: Key[Array, ""], substeps: int = 20) -> CoContractedMotion:
    """Return the motion of an antagonistic loop.

    Args:
        loop: what is simulated.
        key: of the torque sensors' noise.
        substeps: integration steps a sample, of the servos too.
    """
    joint, clock, servo = loop.joint, loop.clock, loop.servo
    sample_time = jnp.asarray(clock.sample_time)
    step_time = sample_time / substeps
    response = propagator(joint.damping_rates(), step_time, has_friction=joint.friction() is not None)
    time = jnp.arange(clock.samples) * clock.sample_time
    intervals = jnp.where(jnp.arange(clock.samples) == 0, 0.0, sample_time)
    noise = loop.torque_std * jax.random.normal(key, (clock.samples, 2))
    zero = jnp.zeros_like(loop.soft)

    def believed(delta: Scalar) -> Scalar:
        return loop.believed1.stiffness(zero, -delta) + loop.believed2.stiffness(zero, delta)

    def true(delta: Scalar) -> Scalar:
        return joint.spring1.stiffness(zero, -delta) + joint.spring2.stiffness(zero, delta)

    def estimated(state: Any) -> Callable[[Scalar], Scalar]:
        def total(delta: Scalar) -> Scalar:
            sides = zip(loop.estimator.both, state, (-delta, delta), strict=True)
            return sum((_slope(side, own, phi) for side, own, phi in sides), zero)

        return total

    def advance(
        state: MechanicalState, last: Scalar, delta: Scalar
    ) -> tuple[MechanicalState, tuple[Scalar, Scalar]]:
        def small(state: MechanicalState, share: Scalar) -> tuple[MechanicalState, tuple[Scalar, Scalar]]:
            target = last + share * (delta - last)
            (_, first, second), (_, first_rate, second_rate) = state
            torques = servo.torque(target, first, first_rate), servo.torque(-target, second, second_rate)
            driven = Torques(zero, zero, zero, *torques)
            return splitting_step(state, response, joint.accelerations(driven), joint.friction()), torques

        state, torques = rollout.scan(small, state, (jnp.arange(substeps) + 1.0) / substeps, segment=substeps)
        return state, (jnp.mean(torques[0]), jnp.mean(torques[1]))

    def sense(mechanics: MechanicalState, torques: tuple[Scalar, Scalar], dt: Scalar, drawn: Any) -> Sample:
        link, first, second = mechanics.positions
        return Sample(
            dt,
            link_position=link,
            motor1_position=first,
            motor2_position=second,
            motor1_torque=torques[0] + drawn[0],
            motor2_torque=torques[1] + drawn[1],
        )

    def step(state: _State, inputs: tuple[Scalar, Scalar, Any]) -> tuple[_State, tuple[Scalar, ...]]:
        _, dt, drawn = inputs
        link, first, second = state.mechanics.positions
        velocity = state.mechanics.velocities[0]
        motion = joint.observe(state.mechanics, Torques(zero, zero, zero, zero, zero))
        pull = motion.elastic_torque + joint.link.load(link) + joint.link.damping * velocity
        swing = Swing(dt, link, velocity, -pull / joint.link.inertia, 0.5 * (first + second))
        controller, command = loop.controller.step(state.controller, swing)
        estimator, answer = loop.estimator.step(state.estimator, sense(state.mechanics, state.torques, dt, drawn))
        follows = answer.known & (loop.uses_estimate > 0.5)
        wanted = jnp.where(
            follows,
            contraction(estimated(estimator), command.stiffness, loop.reach),
            contraction(believed, command.stiffness, loop.reach),
        )
        way = loop.speed * sample_time
        delta = state.contraction + jnp.clip(wanted - state.contraction, -way, way)
        mechanics, torques = advance(state.mechanics, state.contraction, delta)
        known = jnp.where(follows, 1.0, zero)
        apart = 0.5 * (first - second)
        seen = (link, velocity, apart, command.stiffness, true(apart), motion.stiffness, answer.stiffness, known)
        return _State(mechanics, torques, controller, estimator, delta), seen

    still = Swing(zero, zero, zero, zero, zero)
    begin = contraction(believed, loop.start, loop.reach)
    mechanics, torques = _at_rest(loop, begin)
    sample = sense(mechanics, torques, zero, (zero, zero))
    observers = loop.estimator.init(sample)
    # The observers have long watched the joint at rest, where a motor holds its spring.
    observers = eqx.tree_at(
        lambda s: (s.first.torque.residual, s.second.torque.residual), observers, (-torques[0], -torques[1])
    )
    kick = loop.impact.impulses(1)[0] / joint.link.inertia
    hit = mechanics._replace(velocities=(kick + zero, zero, zero))
    start = _State(hit, torques, loop.controller.init(still), observers, begin)
    return CoContractedMotion(time, *rollout.scan(step, start, (time, intervals, noise))[1])


def score(loop: AntagonisticLoop, *, key: Key[Array, ""], substeps: int = 20) -> EstimatedScores:
    """Return how an antagonistic loop came to rest, and how good its estimate was; arguments as of `simulate`."""
    motion = simulate(loop, key=key, substeps=substeps)
    return score_estimated(
        loop.scorer,
        motion,
        energy=0.5 * loop.joint.link.inertia * motion.velocity**2,
        soft=loop.soft,
        stiff=loop.stiff,
        given=motion.given,
        followed=motion.known > 0.0,
        duration=loop.clock.duration,
    )


def _slope(side: Any, state: Any, deflection: Scalar) -> Scalar:
    """Return the stiffness that a side's fit has at a deflection."""
    return dot(side.basis(jnp.zeros_like(deflection), deflection)[1], state.fit.coefficients)


def _at_rest(loop: AntagonisticLoop, delta: Scalar) -> tuple[MechanicalState, tuple[Scalar, Scalar]]:
    """Return the joint at rest with its motors sent to ±δ, and what their servos hold against the springs."""
    joint, servo = loop.joint, loop.servo
    zero = jnp.zeros_like(delta)
    link, first, second = zero, delta, -delta
    # Kp (±δ − qᵢ) = −fᵢ(q − qᵢ) and f₁ + f₂ = 0, by Newton's method in each: the servos are far stiffer.
    for _ in range(_HALVINGS):
        first = delta + joint.spring1.torque(zero, link - first) / servo.proportional
        second = -delta + joint.spring2.torque(zero, link - second) / servo.proportional
        pull = joint.spring1.torque(zero, link - first) + joint.spring2.torque(zero, link - second)
        slope = joint.spring1.stiffness(zero, link - first) + joint.spring2.stiffness(zero, link - second)
        link = link - pull / slope
    torques = servo.torque(delta, first, zero), servo.torque(-delta, second, zero)
    return MechanicalState((link, first, second), (zero, zero, zero)), torques
