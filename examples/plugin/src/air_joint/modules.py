"""What the tables of `air_joint.tables` become: equinox modules, pure and unbatched, with the tables' fields."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp

from vsajax import Estimate, Sample
from vsajax.estimators import AbstractBasis, AbstractEstimator, AbstractTorqueSource, Kinematics
from vsajax.numerics import safe_divide, safe_sqrt
from vsajax.plants import AbstractSpring
from vsajax.types import Scalar, Signals, as_leaf


class AirSpring(AbstractSpring):
    """τ_e = k φ √(1 + u²) with u = φ/knee.

    Args:
        rate: k [N·m/rad].
        knee: deflection from which it stiffens [rad].
    """

    rate: Scalar = eqx.field(converter=as_leaf)
    knee: Scalar = eqx.field(converter=as_leaf, default=0.1)

    def torque(self, setpoint, deflection):
        """Return k φ √(1 + u²)."""
        u = deflection / self.knee
        return self.rate * deflection * jnp.sqrt(1.0 + u * u)

    def stiffness(self, setpoint, deflection):
        """Return k (1 + 2u²)/√(1 + u²)."""
        u = deflection / self.knee
        return self.rate * (1.0 + 2.0 * u * u) / jnp.sqrt(1.0 + u * u)

    def coupling(self, setpoint, deflection):
        """Return 0: no second motor sets its stiffness."""
        return jnp.zeros_like(deflection)


class RootBasis(AbstractBasis):
    """Features x r^j with x = φ / deflection_scale, r = √(1 + u²), u = φ/knee and j < terms.

    Args:
        deflection_scale: [rad].
        knee: [rad].
        terms: ≥ 1.
    """

    deflection_scale: Scalar = eqx.field(converter=as_leaf, default=1.0)
    knee: Scalar = eqx.field(converter=as_leaf, default=0.1)
    terms: int = eqx.field(static=True, default=2)

    @property
    def size(self) -> int:
        """Return the number of terms."""
        return self.terms

    @property
    def uses_setpoint(self) -> bool:
        """Return False."""
        return False

    def __call__(self, setpoint, deflection):
        """Return the features and their slopes: (r^j)' = j u r^(j−2) / knee."""
        x, u = deflection / self.deflection_scale, deflection / self.knee
        square = 1.0 + u * u
        root = jnp.sqrt(square)
        powers = [jnp.ones_like(x)]
        for _ in range(1, self.terms):
            powers.append(powers[-1] * root)
        features = [x * power for power in powers]
        slopes = [
            power / self.deflection_scale + j * x * u * power / (square * self.knee)
            for j, power in enumerate(powers)
        ]
        return jnp.stack(features), jnp.stack(slopes)


class StaticTorque(AbstractTorqueSource):
    """The lagged torque that holds a slow motor: γ (D γ θ̇ − τ) through K/(s + K).

    Args:
        gain: K [1/s].
        motor_damping: D, on the motor axis [N·m·s/rad].
        gear_ratio: γ.
    """

    gain: Scalar = eqx.field(converter=as_leaf)
    motor_damping: Scalar = eqx.field(converter=as_leaf)
    gear_ratio: Scalar = eqx.field(converter=as_leaf, default=1.0)

    @property
    def needs(self) -> frozenset[str]:
        """Return the signals that are read."""
        return frozenset({"motor_position", "motor_torque"})

    @property
    def lag(self) -> Scalar:
        """Return K."""
        return self.gain

    def init(self, sample: Sample) -> Scalar:
        """Start without torque."""
        return jnp.zeros_like(sample.read("motor_torque"))

    def step(self, state: Scalar, sample: Sample, kinematics: Kinematics) -> tuple[Scalar, Scalar]:
        """Return the torque, which is the state."""
        drag = self.motor_damping * self.gear_ratio * kinematics.motor_velocity
        held = self.gear_ratio * (drag - sample.read("motor_torque"))
        share = self.gain * sample.dt / (1.0 + self.gain * sample.dt)
        torque = state + share * (held - state)
        return torque, torque


class SlopeState(NamedTuple):
    """How much is remembered, and of that the means, variances and covariance of deflection and torque."""

    weight: Scalar
    deflection: Scalar
    torque: Scalar
    deflection_variance: Scalar
    torque_variance: Scalar
    covariance: Scalar


class SlopeEstimator(AbstractEstimator):
    """The regression of torque on deflection over a fading memory; the mean slope of a curve, not its tangent.

    Args:
        memory: time in which a sample's weight falls to 1/e [s].
        least_range: standard deviation of the deflection above which the slope is known [rad].
    """

    memory: Scalar = eqx.field(converter=as_leaf)
    least_range: Scalar = eqx.field(converter=as_leaf, default=1e-3)

    @property
    def needs(self) -> frozenset[str]:
        """Names of the signals that a recording must have."""
        return frozenset({"link_position", "motor_position", "elastic_torque"})

    def init(self, sample: Sample) -> SlopeState:
        """Return the state before the first sample."""
        return SlopeState(*(jnp.zeros_like(sample.read("elastic_torque")),) * 6)

    def step(self, state: SlopeState, sample: Sample) -> tuple[SlopeState, Estimate]:
        """Process one sample; return (state, estimate)."""
        torque = sample.read("elastic_torque")
        deflection = sample.read("link_position") - sample.read("motor_position")
        kept = jnp.exp(-sample.dt / self.memory)
        weight = kept * state.weight + (1.0 - kept)
        share = safe_divide(1.0 - kept, weight)
        # Deviations from the means before the sample: after one sample the variances are 0, to the last bit.
        away, torque_away = deflection - state.deflection, torque - state.torque
        mean, torque_mean = state.deflection + share * away, state.torque + share * torque_away
        variance = (1.0 - share) * (state.deflection_variance + share * away * away)
        torque_variance = (1.0 - share) * (state.torque_variance + share * torque_away * torque_away)
        covariance = (1.0 - share) * (state.covariance + share * away * torque_away)
        slope = safe_divide(covariance, variance)
        left = jnp.maximum(torque_variance - slope * covariance, 0.0)
        std = safe_sqrt(safe_divide(left, variance))
        zero = jnp.zeros_like(slope)
        signals = Signals(deflection, torque, zero, zero, zero)
        known = variance > self.least_range**2
        state = SlopeState(weight, mean, torque_mean, variance, torque_variance, covariance)
        return state, Estimate(slope, std, torque_mean + slope * (deflection - mean), known, signals)
