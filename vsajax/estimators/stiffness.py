"""The stiffness estimator of Flacco et al., IROS 2011, as a composition: torque, velocity, basis, fit, gate."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax.numpy as jnp

from vsajax.estimators.attenuation import Attenuation, resolved, start_resolution, variance_of
from vsajax.estimators.base import AbstractEstimator
from vsajax.estimators.bases import AbstractBasis
from vsajax.estimators.gate import ExcitationGate, GateState
from vsajax.estimators.lag import LagState, lagged, start_lag
from vsajax.estimators.rls import FitState, RecursiveLeastSquares, blend_over
from vsajax.estimators.torque import AbstractTorqueSource, Kinematics
from vsajax.estimators.velocity import (
    AbstractVelocityFilter,
    FiniteDifference,
    Followed,
    follow,
    start_following,
)
from vsajax.numerics import Vector, lanes_minor, once
from vsajax.types import Estimate, Sample, Scalar, Signals

_LAGS = 10.0
"""Time constants of the torque's lag over which innovations are averaged: nine tenths of their slow part show."""
_INDEPENDENT = 0.2
"""A sample's share in the average of innovations of a torque that does not lag: some five samples are averaged."""


class EstimatorState(NamedTuple):
    """The states of the parts; `None` for a filter that does not run."""

    motor: Any
    link: Any
    torque: Any
    fit: FitState
    gate: GateState
    attenuation: Attenuation
    lag: LagState | None = None
    followed: tuple[Followed, Followed | None] | None = None


class StiffnessEstimator(AbstractEstimator):
    """Two stages: the elastic torque, then recursive least squares on a basis of deflection and setpoint.

    Args:
        torque: where the elastic torque comes from.
        basis: what it is regressed on.
        fit: the recursive fit.
        velocity: the filter of the motor's readings, and of the link's where the deflection is filtered.
        gate: when the answer is known.
        deflection: "filtered", link minus motor position both filtered, as the paper does; "raw", of the
            readings; "measured", a signal of its own.
        matched: make the features of the fit as late as its torque: deflection and setpoint, and the impulse of
            the motor's torque, go through the filter that its velocity comes from, and the features through the
            observer's lag. This removes the bias of a slow observer and of a slow filter. The answer's stiffness
            and torque are those of the fit at the present deflection. The gains of the fit then depend on the
            observer's gain and the filter too. Without a torque that lags it does nothing.
    """

    torque: AbstractTorqueSource
    basis: AbstractBasis
    fit: RecursiveLeastSquares
    velocity: AbstractVelocityFilter = eqx.field(default_factory=FiniteDifference)
    gate: ExcitationGate = eqx.field(default_factory=ExcitationGate)
    deflection: Literal["filtered", "raw", "measured"] = eqx.field(static=True, default="filtered")
    matched: bool = eqx.field(static=True, default=True)

    @property
    def needs(self) -> frozenset[str]:
        """Names of the signals that a recording must have."""
        positions = {"deflection"} if self.deflection == "measured" else {"link_position", "motor_position"}
        setpoint = {"setpoint_position"} if self.basis.uses_setpoint else set()
        return self.torque.needs | positions | setpoint

    def init(self, sample: Sample) -> EstimatorState:
        """Return the state before the first sample, which `step` then processes as any other.

        Raises:
            MissingSignalError: the sample lacks a signal that the estimator needs.
            PrecisionError: double precision is off.
        """
        deflection, setpoint = self._raw_deflection(sample), self._setpoint(sample)
        motor = self.velocity.init(sample.read("motor_position")) if self._filters_motor else None
        followed = None
        if self._lags and self.velocity.gains(motor) is not None:
            followed = start_following(deflection), start_following(setpoint) if self.basis.uses_setpoint else None
        return EstimatorState(
            motor=motor,
            link=self.velocity.init(sample.read("link_position")) if self._filters_link else None,
            torque=self.torque.init(sample),
            fit=self.fit.init(self.basis.size),
            gate=self.gate.init(deflection),
            attenuation=Attenuation(
                tuple(map(start_resolution, self._positions(sample))),
                jnp.zeros_like(self.basis(setpoint, deflection)[1]),
            ),
            lag=start_lag(self.basis(setpoint, deflection)[0]) if self._lags else None,
            followed=followed,
        )

    def step(self, state: EstimatorState, sample: Sample) -> tuple[EstimatorState, Estimate]:
        """Process one sample; return (state, estimate)."""
        motor, link, kinematics = self._filter(state, sample)
        torque_state, torque = self.torque.step(state.torque, sample, kinematics)
        kinematics, torque = once((kinematics, torque))
        features, slopes = once(self.basis(kinematics.setpoint, kinematics.deflection))
        followed, regressors = self._follow(state.followed, kinematics, sample), features
        if followed is not None:
            setpoint = kinematics.setpoint if followed[1] is None else followed[1].value
            regressors = once(self.basis(setpoint, followed[0].value)[0])
        lag, gain = state.lag, self.torque.lag
        if lag is not None and gain is not None:
            lag = lagged(lag, regressors, gain, sample.dt)
            regressors = lag.outputs
        blend = _INDEPENDENT if self.torque.lag is None else blend_over(sample.dt, _LAGS / self.torque.lag)
        fit, factor = self.fit.step(state.fit, regressors, torque, blend=blend)
        stiffness = once(self.fit.predict(fit, slopes))
        attenuation = self._attenuated(state.attenuation, sample, stiffness, slopes)
        pull = variance_of(attenuation.readings) * attenuation.pull
        std = once(jnp.sqrt(self.fit.variance(fit, slopes, pull)))
        gate, known = self.gate.step(state.gate, kinematics.deflection, stiffness, std)
        signals = Signals(
            kinematics.deflection, torque, kinematics.motor_velocity, factor, self.fit.determined(fit)
        )
        estimate = Estimate(stiffness, std, self.fit.predict(fit, features), known, signals)
        return EstimatorState(motor, link, torque_state, fit, gate, attenuation, lag, followed), estimate

    @property
    def _filters_motor(self) -> bool:
        return self.deflection == "filtered" or "motor_position" in self.torque.needs

    @property
    def _filters_link(self) -> bool:
        return self.deflection == "filtered"

    @property
    def _lags(self) -> bool:
        return self.matched and self.torque.lag is not None

    def _setpoint(self, sample: Sample) -> Scalar:
        has_setpoint = self.basis.uses_setpoint or sample.setpoint_position is not None
        return sample.read("setpoint_position") if has_setpoint else jnp.zeros_like(sample.dt)

    def _positions(self, sample: Sample) -> tuple[Scalar, ...]:
        """Return the readings whose difference the deflection is."""
        if self.deflection == "measured":
            return (sample.read("deflection"),)
        return sample.read("link_position"), sample.read("motor_position")

    def _attenuated(self, state: Attenuation, sample: Sample, stiffness: Scalar, slopes: Vector) -> Attenuation:
        readings = tuple(map(resolved, state.readings, self._positions(sample)))
        memory = self.fit.law.memory()
        pull = state.pull if memory is None else memory * state.pull
        return Attenuation(readings, lanes_minor(pull + stiffness * slopes))

    def _raw_deflection(self, sample: Sample) -> Scalar:
        if self.deflection == "measured":
            return sample.read("deflection")
        return sample.read("link_position") - sample.read("motor_position")

    def _filter(self, state: EstimatorState, sample: Sample) -> tuple[Any, Any, Kinematics]:
        motor, link, deflection = state.motor, state.link, self._raw_deflection(sample)
        position = velocity = jnp.zeros_like(deflection)
        if self._filters_motor:
            reading = sample.read("motor_position")
            motor, (position, velocity) = self.velocity.step(motor, reading, sample.dt)
        if self._filters_link:
            reading = sample.read("link_position")
            link, (link_position, _) = self.velocity.step(link, reading, sample.dt)
            deflection = link_position - position
        gains = None if state.followed is None else self.velocity.gains(motor)
        return motor, link, Kinematics(deflection, self._setpoint(sample), position, velocity, gains)

    def _follow(
        self, state: tuple[Followed, Followed | None] | None, kinematics: Kinematics, sample: Sample
    ) -> tuple[Followed, Followed | None] | None:
        """Return deflection and setpoint behind the motor's filter."""
        gains = kinematics.gains
        if state is None or gains is None:
            return None
        deflection, setpoint = state
        deflection = once(follow(deflection, self._raw_deflection(sample), gains, sample.dt))
        if setpoint is not None:
            setpoint = once(follow(setpoint, kinematics.setpoint, gains, sample.dt))
        return deflection, setpoint
