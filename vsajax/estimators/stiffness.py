"""The stiffness estimator of Flacco et al., IROS 2011, as a composition: torque, velocity, basis, fit, gate."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax.numpy as jnp

from vsajax.estimators.base import AbstractEstimator
from vsajax.estimators.bases import AbstractBasis
from vsajax.estimators.gate import ExcitationGate, GateState
from vsajax.estimators.lag import LagState, lagged, start_lag
from vsajax.estimators.rls import FitState, RecursiveLeastSquares
from vsajax.estimators.torque import AbstractTorqueSource, Kinematics
from vsajax.estimators.velocity import AbstractVelocityFilter, FiniteDifference
from vsajax.numerics import once
from vsajax.types import Estimate, Sample, Scalar, Signals


class EstimatorState(NamedTuple):
    """The states of the parts; `None` for a filter that does not run."""

    motor: Any
    link: Any
    torque: Any
    fit: FitState
    gate: GateState
    lag: LagState | None = None


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
        matched: pass the features through the observer's lag before the fit; this removes the bias of a slow
            observer. The answer's stiffness and torque are those of the fit, without lag. The gains of the fit
            then depend on the observer's gain too.
    """

    torque: AbstractTorqueSource
    basis: AbstractBasis
    fit: RecursiveLeastSquares
    velocity: AbstractVelocityFilter = eqx.field(default_factory=FiniteDifference)
    gate: ExcitationGate = eqx.field(default_factory=ExcitationGate)
    deflection: Literal["filtered", "raw", "measured"] = eqx.field(static=True, default="filtered")
    matched: bool = eqx.field(static=True, default=False)

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
        deflection = self._raw_deflection(sample)
        return EstimatorState(
            motor=self.velocity.init(sample.read("motor_position")) if self._filters_motor else None,
            link=self.velocity.init(sample.read("link_position")) if self._filters_link else None,
            torque=self.torque.init(sample),
            fit=self.fit.init(self.basis.size),
            gate=self.gate.init(deflection),
            lag=start_lag(self.basis(self._setpoint(sample), deflection)[0]) if self._lags else None,
        )

    def step(self, state: EstimatorState, sample: Sample) -> tuple[EstimatorState, Estimate]:
        """Process one sample; return (state, estimate)."""
        motor, link, kinematics = self._filter(state, sample)
        torque_state, torque = self.torque.step(state.torque, sample, kinematics)
        kinematics, torque = once((kinematics, torque))
        features, slopes = once(self.basis(kinematics.setpoint, kinematics.deflection))
        lag, gain, regressors = state.lag, self.torque.lag, features
        if lag is not None and gain is not None:
            lag = lagged(lag, features, gain, sample.dt)
            regressors = lag.outputs
        fit, factor = self.fit.step(state.fit, regressors, torque)
        stiffness = once(self.fit.predict(fit, slopes))
        std = once(jnp.sqrt(jnp.maximum(self.fit.variance(fit, slopes), 0.0)))
        gate, known = self.gate.step(state.gate, kinematics.deflection, stiffness, std)
        signals = Signals(
            kinematics.deflection, torque, kinematics.motor_velocity, factor, self.fit.determined(fit)
        )
        estimate = Estimate(stiffness, std, self.fit.predict(fit, features), known, signals)
        return EstimatorState(motor, link, torque_state, fit, gate, lag), estimate

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
        return motor, link, Kinematics(deflection, self._setpoint(sample), position, velocity)
