"""The progressive springs of an arm whose joints' stiffness is preset."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from vsajax.plants.springs import AbstractSpring
from vsajax.types import as_leaf

Value = Float[Array, "..."]


class PresetSpring(AbstractSpring):
    """τ_e = σ φ_s sinh(φ/φ_s): the set-point σ is the stiffness without load, and it grows with the torque.

    Petit, Albu-Schäffer leave their f(φ, σ) of (15) open; this is the simplest law with its traits. Its stiffness
    is √(σ² + (τ_e/φ_s)²), so that a joint that bears a load has a least stiffness above that of its softest
    preset: the starred entries of Table I.

    Args:
        progression: φ_s, the deflection at which it stiffens [rad].
    """

    progression: Float[Array, "..."] = eqx.field(converter=as_leaf)

    def torque(self, setpoint: Value, deflection: Value) -> Value:
        """Return σ φ_s sinh(φ/φ_s)."""
        return setpoint * self.progression * jnp.sinh(deflection / self.progression)

    def stiffness(self, setpoint: Value, deflection: Value) -> Value:
        """Return σ cosh(φ/φ_s)."""
        return setpoint * jnp.cosh(deflection / self.progression)

    def coupling(self, setpoint: Value, deflection: Value) -> Value:
        """Return φ_s² (cosh(φ/φ_s) − 1), the derivative of the energy by the set-point."""
        return self.progression**2 * (jnp.cosh(deflection / self.progression) - 1.0)

    def loaded_stiffness(self, setpoint: Value, torque: Value) -> Value:
        """Return the stiffness under a torque; at the softest preset it is the lower bound k_min."""
        return jnp.sqrt(setpoint**2 + (torque / self.progression) ** 2)

    def preset(self, stiffness: Value, torque: Value) -> Value:
        """Return the set-point that has this stiffness under this torque; NaN where none has."""
        return jnp.sqrt(stiffness**2 - (torque / self.progression) ** 2)

    def deflection(self, setpoint: Value, torque: Value) -> Value:
        """Return the deflection φ under a torque [rad]."""
        return self.progression * jnp.arcsinh(torque / (setpoint * self.progression))
