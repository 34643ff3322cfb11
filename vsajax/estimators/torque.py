"""Where the elastic torque that the fit explains comes from: a model, a sensor, or the motor residual."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, NamedTuple, Protocol, runtime_checkable

import equinox as eqx
import jax.numpy as jnp

from vsajax.estimators.velocity import Followed, Gains
from vsajax.numerics import smooth_sign
from vsajax.types import RunningSum, Sample, Scalar, as_leaf, optional_leaf


class Kinematics(NamedTuple):
    """What the velocity filters made of a sample.

    Args:
        deflection: φ [rad].
        setpoint: θ_c [rad]; 0 where none is measured.
        motor_position: θ [rad].
        motor_velocity: θ̇ [rad/s].
        gains: of the motor's filter, where what is set against its position is to be as late; else `None`.
    """

    deflection: Scalar
    setpoint: Scalar
    motor_position: Scalar
    motor_velocity: Scalar
    gains: Gains | None = None


@runtime_checkable
class ElasticLaw(Protocol):
    """Anything that gives an elastic torque, such as the springs of `vsajax.plants`."""

    def torque(self, setpoint: Any, deflection: Any) -> Any:
        """Return the elastic torque [N·m]."""


class AbstractTorqueSource(eqx.Module):
    """A signal of the elastic torque."""

    @property
    @abstractmethod
    def needs(self) -> frozenset[str]:
        """Names of the signals that a sample must have."""

    @property
    @abstractmethod
    def lag(self) -> Scalar | None:
        """Gain K of the lag K/(s + K) of the signal behind the torque [1/s]; `None` without one."""

    @abstractmethod
    def init(self, sample: Sample) -> Any:
        """Return the state before the first sample is processed."""

    @abstractmethod
    def step(self, state: Any, sample: Sample, kinematics: Kinematics) -> tuple[Any, Scalar]:
        """Return (state, elastic torque [N·m])."""


class SensorTorque(AbstractTorqueSource):
    """The reading of a joint torque sensor: SENSOR in (34) of Flacco et al., IROS 2011."""

    @property
    def needs(self) -> frozenset[str]:
        """Return the signals that are read."""
        return frozenset({"elastic_torque"})

    @property
    def lag(self) -> None:
        """There is none."""
        return None

    def init(self, sample: Sample) -> tuple[()]:
        """There is nothing to remember."""
        return ()

    def step(self, state: tuple[()], sample: Sample, kinematics: Kinematics) -> tuple[tuple[()], Scalar]:
        """Return the sensor's reading."""
        return state, sample.read("elastic_torque")


class ModelTorque(AbstractTorqueSource):
    """The torque of a nominal law at the measured deflection and setpoint: MODEL in (34).

    Args:
        law: the nominal characteristic, e.g. a spring of `vsajax.plants`.
    """

    law: ElasticLaw

    @property
    def needs(self) -> frozenset[str]:
        """Return the signals that are read."""
        return frozenset()

    @property
    def lag(self) -> None:
        """There is none."""
        return None

    def init(self, sample: Sample) -> tuple[()]:
        """There is nothing to remember."""
        return ()

    def step(self, state: tuple[()], sample: Sample, kinematics: Kinematics) -> tuple[tuple[()], Scalar]:
        """Return the law's torque."""
        return state, self.law.torque(kinematics.setpoint, kinematics.deflection)


class ResidualState(NamedTuple):
    """The residual [N·m on the motor axis], its unfiltered momentum balance, and what the integral needs.

    Args:
        residual: r_e.
        balance: r/K_I.
        impulse: I.
        torque: τ at the last sample.
        behind: by how much I, through the filter of the motor's position, is behind I; and the rate of that I.
    """

    residual: Scalar
    balance: RunningSum
    impulse: RunningSum
    torque: Scalar
    behind: Followed


class ResidualTorque(AbstractTorqueSource):
    """The residual-based torque observer (6)–(8): γ r_e, with r_e a first-order filter of τ_e/γ.

    I(k) = I(k−1) + ½(τ(k) + τ(k−1)) T, r(k) = K_I (B γ θ̇(k) + D_θ γ θ(k) − I(k)),
    r_e(k) = ((2 − T K_I) r_e(k−1) + 2 (r(k) − r(k−1))) / (2 + T K_I).
    T is the time since the last sample and may vary. Printed (7) makes r_e itself the fit's input; the torque
    on the joint side is γ r_e, as (34) says.

    θ̇ and θ are late by the filter that they come from, and I is not: where friction or inertia take most of the
    torque, their difference is not the elastic torque. With the filter's gains in `Kinematics`, I goes through the
    same filter, and γ r_e is the elastic torque through filter and lag.

    Args:
        observer_gain: K_I [1/s]; the observer's bandwidth. Above 2/T it rings.
        motor_inertia: B, as the estimator believes it [kg·m²].
        motor_damping: D_θ on the motor axis [N·m·s/rad].
        gear_ratio: γ.
        friction_torque: Coulomb friction on the motor axis, smoothed by tanh [N·m], or `None`.
        friction_velocity: the smoothing velocity, on the joint side [rad/s].
    """

    observer_gain: Scalar = eqx.field(converter=as_leaf)
    motor_inertia: Scalar = eqx.field(converter=as_leaf)
    motor_damping: Scalar = eqx.field(converter=as_leaf)
    gear_ratio: Scalar = eqx.field(converter=as_leaf, default=1.0)
    friction_torque: Scalar | None = eqx.field(converter=optional_leaf, default=None)
    friction_velocity: Scalar = eqx.field(converter=as_leaf, default=0.05)

    @property
    def needs(self) -> frozenset[str]:
        """Return the signals that are read."""
        return frozenset({"motor_position", "motor_torque"})

    @property
    def lag(self) -> Scalar:
        """Return K_I."""
        return self.observer_gain

    def init(self, sample: Sample) -> ResidualState:
        """Start with zero residual at rest at the first sample."""
        position = sample.read("motor_position")
        torque = sample.read("motor_torque")
        zero = jnp.zeros_like(position)
        return ResidualState(zero, self._balance(position, zero, zero), zero, torque, Followed(zero, zero))

    def step(self, state: ResidualState, sample: Sample, kinematics: Kinematics) -> tuple[ResidualState, Scalar]:
        """Return the elastic torque γ r_e."""
        torque = sample.read("motor_torque")
        if self.friction_torque is not None:
            torque = torque - self.friction_torque * smooth_sign(kinematics.motor_velocity, self.friction_velocity)
        added = 0.5 * (torque + state.torque) * sample.dt
        impulse, behind = state.impulse + added, state.behind
        if kinematics.gains is not None:
            # Of the difference, which stays small while I grows.
            missing = behind.value + added - sample.dt * behind.rate
            share, pace = kinematics.gains
            behind = Followed(missing - share * missing, behind.rate + pace * missing)
        balance = self._balance(kinematics.motor_position, kinematics.motor_velocity, impulse - behind.value)
        gain_step = self.observer_gain * sample.dt
        residual = ((2.0 - gain_step) * state.residual + 2.0 * self.observer_gain * (balance - state.balance)) / (
            2.0 + gain_step
        )
        return ResidualState(residual, balance, impulse, torque, behind), self.gear_ratio * residual

    def _balance(self, position: Scalar, velocity: Scalar, impulse: Scalar) -> Scalar:
        """Return B γ θ̇ + D_θ γ θ − I [N·m·s]."""
        momentum = self.motor_inertia * velocity + self.motor_damping * position
        return self.gear_ratio * momentum - impulse
