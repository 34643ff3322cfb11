"""Position and velocity from encoder readings.

Letters of Flacco et al., IROS 2011: x position, ẋ velocity, z reading, V_a acceleration variance, R reading
variance, Γ = (T²/2, T)ᵀ, Q = V_a ΓΓᵀ.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax.numpy as jnp

from vsajax.numerics import logistic, safe_divide
from vsajax.types import Scalar, as_leaf


class Gains(NamedTuple):
    """What a filter made of its last innovation: how far position and velocity [1/s] follow it."""

    position: Scalar
    velocity: Scalar


class KalmanState(NamedTuple):
    """Estimate and covariance of position [rad] and velocity [rad/s], and the last gains."""

    position: Scalar
    velocity: Scalar
    position_variance: Scalar
    covariance: Scalar
    velocity_variance: Scalar
    gains: Gains


class Followed(NamedTuple):
    """A signal behind a filter that is not its own, and its rate."""

    value: Scalar
    rate: Scalar


def start_following(value: Scalar) -> Followed:
    """Return the state at a first value, at rest."""
    return Followed(value, jnp.zeros_like(value))


def follow(state: Followed, value: Scalar, gains: Gains, dt: Scalar) -> Followed:
    """Return where a signal is behind the filter that has these gains, as late as what that filter returns.

    Args:
        state: of the last sample.
        value: the signal, unfiltered.
        gains: of the filter at this sample.
        dt: since the last sample [s].
    """
    ahead = state.value + dt * state.rate
    innovation = value - ahead
    return Followed(ahead + gains.position * innovation, state.rate + gains.velocity * innovation)


class DifferenceState(NamedTuple):
    """The last reading [rad] and velocity [rad/s]."""

    position: Scalar
    velocity: Scalar


class AbstractVelocityFilter(eqx.Module):
    """A filter from readings of one position to position and velocity."""

    @abstractmethod
    def init(self, position: Scalar) -> Any:
        """Return the state before the first reading is processed."""

    @abstractmethod
    def step(self, state: Any, position: Scalar, dt: Scalar) -> tuple[Any, tuple[Scalar, Scalar]]:
        """Process a reading taken `dt` [s] after the last; return (state, (position, velocity))."""

    def gains(self, state: Any) -> Gains | None:
        """Return the gains with which the last reading was processed; `None` of a filter that delays nothing."""
        return None


class FiniteDifference(AbstractVelocityFilter):
    """ẋ(k) = (z(k) − z(k−1)) / T."""

    def init(self, position: Scalar) -> DifferenceState:
        """Start at rest at the first reading."""
        return DifferenceState(position, jnp.zeros_like(position))

    def step(
        self, state: DifferenceState, position: Scalar, dt: Scalar
    ) -> tuple[DifferenceState, tuple[Scalar, Scalar]]:
        """Return the reading itself and the slope from the last one."""
        state = DifferenceState(position, safe_divide(position - state.position, dt))
        return state, (state.position, state.velocity)


class KinematicKalman(AbstractVelocityFilter):
    """Kinematic Kalman filter (9)–(10) with a constant reading variance.

    Args:
        acceleration_variance: V_a [rad²/s⁴].
        reading_variance: R [rad²]; only V_a/R matters once the start is forgotten.
        start_position_variance: of the first reading [rad²].
        start_velocity_variance: of rest at the start [rad²/s²].
    """

    acceleration_variance: Scalar = eqx.field(converter=as_leaf)
    reading_variance: Scalar = eqx.field(converter=as_leaf)
    start_position_variance: Scalar = eqx.field(converter=as_leaf, default=10.0)
    start_velocity_variance: Scalar = eqx.field(converter=as_leaf, default=1.0)

    def init(self, position: Scalar) -> KalmanState:
        """Start at rest at the first reading."""
        zero = jnp.zeros_like(position)
        variances = self.start_position_variance, zero, self.start_velocity_variance
        return KalmanState(position, zero, *variances, Gains(zero, zero))

    def step(self, state: KalmanState, position: Scalar, dt: Scalar) -> tuple[KalmanState, tuple[Scalar, Scalar]]:
        """Predict over `dt`, correct with the reading."""
        state = _predict_and_correct(state, position, dt, self.acceleration_variance, self.reading_variance)
        return state, (state.position, state.velocity)

    def gains(self, state: KalmanState) -> Gains:
        """Return the Kalman gains."""
        return state.gains


class ModifiedKinematicKalman(AbstractVelocityFilter):
    """Modified kinematic Kalman filter (MKKF): R falls with speed, eq. (11).

    R(k) = (V_max − V_min) / (1 + e^((n − 1) α)) + V_min, where n is the speed in encoder counts a sample.
    Printed is n = |ẋ| w_s with w_s = (2π/Δ)/T, which is not dimensionless; |ẋ| / w_s is what the text
    describes (large R at low speed). `scaling="printed"` keeps the printed form. ẋ is the last estimate.

    Args:
        acceleration_variance: V_a [rad²/s⁴].
        slow_variance: V_max, R at rest [rad²].
        fast_variance: V_min, R at high speed [rad²].
        sharpness: α, dimensionless.
        counts_per_revolution: Δ of the encoder.
        start_position_variance: of the first reading [rad²].
        start_velocity_variance: of rest at the start [rad²/s²].
        scaling: "counts" (corrected) or "printed".
    """

    acceleration_variance: Scalar = eqx.field(converter=as_leaf)
    slow_variance: Scalar = eqx.field(converter=as_leaf, default=10.0)
    fast_variance: Scalar = eqx.field(converter=as_leaf, default=0.1)
    sharpness: Scalar = eqx.field(converter=as_leaf, default=6.0)
    counts_per_revolution: Scalar = eqx.field(converter=as_leaf, default=40000.0)
    start_position_variance: Scalar = eqx.field(converter=as_leaf, default=10.0)
    start_velocity_variance: Scalar = eqx.field(converter=as_leaf, default=1.0)
    scaling: Literal["counts", "printed"] = eqx.field(static=True, default="counts")

    def init(self, position: Scalar) -> KalmanState:
        """Start at rest at the first reading."""
        zero = jnp.zeros_like(position)
        variances = self.start_position_variance, zero, self.start_velocity_variance
        return KalmanState(position, zero, *variances, Gains(zero, zero))

    def step(self, state: KalmanState, position: Scalar, dt: Scalar) -> tuple[KalmanState, tuple[Scalar, Scalar]]:
        """Predict over `dt`, correct with the reading."""
        count = 2.0 * jnp.pi / self.counts_per_revolution
        speed = jnp.abs(state.velocity)
        scaled = speed * dt / count if self.scaling == "counts" else safe_divide(speed * count, dt)
        spread = self.slow_variance - self.fast_variance
        variance = spread * logistic((scaled - 1.0) * self.sharpness) + self.fast_variance
        state = _predict_and_correct(state, position, dt, self.acceleration_variance, variance)
        return state, (state.position, state.velocity)

    def gains(self, state: KalmanState) -> Gains:
        """Return the Kalman gains."""
        return state.gains


def _predict_and_correct(
    state: KalmanState, reading: Scalar, dt: Scalar, acceleration_variance: Scalar, reading_variance: Scalar
) -> KalmanState:
    half_square = 0.5 * dt * dt
    position = state.position + dt * state.velocity
    cross = state.covariance + dt * state.velocity_variance
    position_variance = (
        state.position_variance
        + dt * (state.covariance + cross)
        + acceleration_variance * half_square * half_square
    )
    cross = cross + acceleration_variance * half_square * dt
    velocity_variance = state.velocity_variance + acceleration_variance * dt * dt
    precision = 1.0 / (position_variance + reading_variance)
    position_gain = position_variance * precision
    velocity_gain = cross * precision
    innovation = reading - position
    return KalmanState(
        position + position_gain * innovation,
        state.velocity + velocity_gain * innovation,
        position_variance * (1.0 - position_gain),
        cross * (1.0 - position_gain),
        velocity_variance - velocity_gain * cross,
        Gains(position_gain, velocity_gain),
    )
