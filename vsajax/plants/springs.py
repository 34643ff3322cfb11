"""Elastic transmissions: torque and stiffness against deflection.

Letters of the papers: φ deflection, τ_e torque, σ stiffness, θ_c setpoint, ψ_e coupling torque. Every law is
odd in φ (assumption (1) of Flacco et al., IROS 2011) but `ExponentialSpring`, one side of an antagonistic pair.
"""

from __future__ import annotations

from abc import abstractmethod

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from vsajax import numerics
from vsajax.types import Scalar, as_leaf

Value = Float[Array, "..."]


class AbstractSpring(eqx.Module):
    """A transmission's elastic characteristic at a setpoint of the stiffness-setting motor."""

    @abstractmethod
    def torque(self, setpoint: Value, deflection: Value) -> Value:
        """Return the elastic torque τ_e [N·m]."""

    @abstractmethod
    def stiffness(self, setpoint: Value, deflection: Value) -> Value:
        """Return σ = ∂τ_e/∂φ [N·m/rad]."""

    @abstractmethod
    def coupling(self, setpoint: Value, deflection: Value) -> Value:
        """Return ψ_e = ∂U/∂θ_c, the torque on the stiffness-setting motor [N·m]; 0 for a fixed spring."""


class LinearSpring(AbstractSpring):
    """τ_e = k φ.

    Args:
        rate: k [N·m/rad].
    """

    rate: Scalar = eqx.field(converter=as_leaf)

    def torque(self, setpoint: Value, deflection: Value) -> Value:
        """Return k φ."""
        return self.rate * deflection

    def stiffness(self, setpoint: Value, deflection: Value) -> Value:
        """Return k."""
        return self.rate * jnp.ones_like(deflection)

    def coupling(self, setpoint: Value, deflection: Value) -> Value:
        """Return 0."""
        return jnp.zeros_like(deflection)


class CubicSpring(AbstractSpring):
    """τ_e = k₁ φ + k₃ φ³.

    Args:
        linear: k₁ [N·m/rad].
        cubic: k₃ [N·m/rad³].
    """

    linear: Scalar = eqx.field(converter=as_leaf)
    cubic: Scalar = eqx.field(converter=as_leaf)

    def torque(self, setpoint: Value, deflection: Value) -> Value:
        """Return k₁ φ + k₃ φ³."""
        return deflection * (self.linear + self.cubic * deflection * deflection)

    def stiffness(self, setpoint: Value, deflection: Value) -> Value:
        """Return k₁ + 3 k₃ φ²."""
        return self.linear + 3.0 * self.cubic * deflection * deflection

    def coupling(self, setpoint: Value, deflection: Value) -> Value:
        """Return 0."""
        return jnp.zeros_like(deflection)


class PolynomialSpring(AbstractSpring):
    """τ_e = Σ αᵢ φ^(2i+1), the odd polynomial (18) of Flacco et al., IROS 2011.

    Args:
        coefficients: α₀, α₁, … [N·m/rad^(2i+1)].
    """

    coefficients: Float[Array, " terms"] = eqx.field(converter=as_leaf)

    def torque(self, setpoint: Value, deflection: Value) -> Value:
        """Return Σ αᵢ φ^(2i+1)."""
        square = deflection * deflection
        total = jnp.zeros_like(deflection)
        for i in reversed(range(self.coefficients.shape[0])):
            total = total * square + self.coefficients[i]
        return total * deflection

    def stiffness(self, setpoint: Value, deflection: Value) -> Value:
        """Return Σ (2i+1) αᵢ φ^(2i)."""
        square = deflection * deflection
        total = jnp.zeros_like(deflection)
        for i in reversed(range(self.coefficients.shape[0])):
            total = total * square + (2 * i + 1) * self.coefficients[i]
        return total

    def coupling(self, setpoint: Value, deflection: Value) -> Value:
        """Return 0."""
        return jnp.zeros_like(deflection)


class ExponentialSpring(AbstractSpring):
    """τ_e = s k (e^(s a φ) − 1), a one-sided progressive spring.

    Args:
        torque_scale: k [N·m].
        exponent: a [1/rad].
        side: s, +1 or −1, the direction in which it stiffens.
    """

    torque_scale: Scalar = eqx.field(converter=as_leaf)
    exponent: Scalar = eqx.field(converter=as_leaf)
    side: Scalar = eqx.field(converter=as_leaf, default=1.0)

    def torque(self, setpoint: Value, deflection: Value) -> Value:
        """Return s k (e^(s a φ) − 1)."""
        return self.side * self.torque_scale * jnp.expm1(self.side * self.exponent * deflection)

    def stiffness(self, setpoint: Value, deflection: Value) -> Value:
        """Return k a e^(s a φ)."""
        return self.torque_scale * self.exponent * jnp.exp(self.side * self.exponent * deflection)

    def coupling(self, setpoint: Value, deflection: Value) -> Value:
        """Return 0."""
        return jnp.zeros_like(deflection)


class HyperbolicSpring(AbstractSpring):
    """τ_e = k sinh(a φ), the progressive spring of qbmove-like modules.

    Args:
        torque_scale: k [N·m].
        exponent: a [1/rad].
    """

    torque_scale: Scalar = eqx.field(converter=as_leaf)
    exponent: Scalar = eqx.field(converter=as_leaf)

    def torque(self, setpoint: Value, deflection: Value) -> Value:
        """Return k sinh(a φ)."""
        return self.torque_scale * jnp.sinh(self.exponent * deflection)

    def stiffness(self, setpoint: Value, deflection: Value) -> Value:
        """Return k a cosh(a φ)."""
        return self.torque_scale * self.exponent * jnp.cosh(self.exponent * deflection)

    def coupling(self, setpoint: Value, deflection: Value) -> Value:
        """Return 0."""
        return jnp.zeros_like(deflection)


class LeverSpring(AbstractSpring):
    """τ_e = k_s r² sin 2φ with lever arm r = r₀ + b θ_c: the AwAS, eqs. (28)–(31) of Flacco et al., IROS 2011.

    Printed are r = r₀ − bθ_c (30) and ψ_e = −2 k_s b r sin²φ (31). With the start that explains Table I,
    r(0) = 70 mm from θ_c(0) = −0.03/b, the arm is r₀ + bθ_c and hence ψ_e = ∂U/∂θ_c = +2 k_s b r sin²φ.

    Args:
        spring_rate: k_s [N/m].
        arm: r₀, the lever arm at θ_c = 0 [m].
        pitch: b, lever travel per setpoint angle [m/rad].
    """

    spring_rate: Scalar = eqx.field(converter=as_leaf)
    arm: Scalar = eqx.field(converter=as_leaf)
    pitch: Scalar = eqx.field(converter=as_leaf)

    def lever(self, setpoint: Value) -> Value:
        """Return the lever arm r [m]."""
        return self.arm + self.pitch * setpoint

    def torque(self, setpoint: Value, deflection: Value) -> Value:
        """Return k_s r² sin 2φ; |φ| < π/2."""
        arm = self.lever(setpoint)
        sine = numerics.once(numerics.sin(deflection))
        # One sine serves torque and coupling: cos φ is its root on the half turn that a transmission can reach.
        cosine = numerics.once(jnp.sqrt(1.0 - sine * sine))
        return 2.0 * self.spring_rate * arm * arm * sine * cosine

    def stiffness(self, setpoint: Value, deflection: Value) -> Value:
        """Return 2 k_s r² cos 2φ."""
        arm = self.lever(setpoint)
        sine = numerics.once(numerics.sin(deflection))
        return 2.0 * self.spring_rate * arm * arm * (1.0 - 2.0 * sine * sine)

    def coupling(self, setpoint: Value, deflection: Value) -> Value:
        """Return 2 k_s b r sin²φ."""
        sine = numerics.once(numerics.sin(deflection))
        return 2.0 * self.spring_rate * self.pitch * self.lever(setpoint) * sine * sine
