"""The rigid bodies of a joint: its link and its geared motors, each with its own friction."""

from __future__ import annotations

import equinox as eqx
from jaxtyping import Array, Float

from vsajax import numerics
from vsajax.types import Scalar, as_leaf, optional_leaf

Value = Float[Array, "..."]


class CoulombFriction(eqx.Module):
    """Dry friction τ_c tanh(v / v_s), smoothed over a small velocity.

    Args:
        torque: τ_c, on the axis of the body that rubs [N·m].
        velocity_scale: v_s [rad/s]; friction is τ_c to 1 % beyond 2.6 v_s.
    """

    torque: Scalar = eqx.field(converter=as_leaf)
    velocity_scale: Scalar = eqx.field(converter=as_leaf, default=0.05)

    def __call__(self, velocity: Value) -> Value:
        """Return the friction torque opposing `velocity` [N·m]."""
        return self.torque * numerics.smooth_sign(velocity, self.velocity_scale)


class Link(eqx.Module):
    """A rigid link, M q̈ + D_q q̇ + g sin q + friction, eq. (2) of Flacco et al., IROS 2011.

    Args:
        inertia: M [kg·m²].
        damping: D_q [N·m·s/rad].
        gravity: torque of gravity with the link horizontal, m g l [N·m]; `None` for a link that carries none.
        friction: Coulomb friction of the link bearing, or `None`.
    """

    inertia: Scalar = eqx.field(converter=as_leaf)
    damping: Scalar = eqx.field(converter=as_leaf)
    gravity: Scalar | None = eqx.field(converter=optional_leaf, default=None)
    friction: CoulombFriction | None = None

    def load(self, position: Value) -> Value:
        """Return the gravity torque g(q), zero with the link hanging down [N·m]."""
        return 0.0 * position if self.gravity is None else self.gravity * numerics.sin(position)


class Motor(eqx.Module):
    """A geared motor, Bγ θ̈ + D γ θ̇ = torques on the motor axis, eq. (3) of Flacco et al., IROS 2011.

    Args:
        inertia: B, of the rotor [kg·m²].
        damping: D_θ, on the motor axis [N·m·s/rad].
        gear_ratio: γ ≥ 1.
        friction: Coulomb friction on the motor axis against the joint-side velocity, or `None`.
    """

    inertia: Scalar = eqx.field(converter=as_leaf)
    damping: Scalar = eqx.field(converter=as_leaf)
    gear_ratio: Scalar = eqx.field(converter=as_leaf, default=1.0)
    friction: CoulombFriction | None = None

    def acceleration(self, torque: Value) -> Value:
        """Return the joint-side acceleration from a torque on the motor axis [rad/s²]."""
        return torque * (1.0 / (self.inertia * self.gear_ratio))
