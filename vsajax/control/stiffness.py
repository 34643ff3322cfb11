"""Controllers that damp by stiffness: hard and smooth switching, and none."""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool

from vsajax.control.base import AbstractController
from vsajax.control.rules import AbstractRule, Conic
from vsajax.types import Command, Scalar, Swing, as_leaf, optional_leaf


class ConstantStiffness(AbstractController):
    """One stiffness, whatever happens.

    Args:
        stiffness: [N·m/rad].
    """

    stiffness: Scalar = eqx.field(converter=as_leaf)

    def init(self, swing: Swing) -> tuple[()]:
        """Return nothing."""
        return ()

    def step(self, state: tuple[()], swing: Swing) -> tuple[tuple[()], Command]:
        """Return the stiffness, with the motor at rest."""
        return state, Command(self.stiffness, jnp.zeros_like(swing.position))


class Hold(eqx.Module):
    """Keeps the last command where the sign of the drive is not to be believed.

    The actuator needs it more than the damping does: noise of 1e-3 rad makes law (23) switch hundreds of times a
    second. A fixed product band ends the damping at swings smaller than itself.

    Args:
        product: hold while |drive| is at or below it [rad²/s].
        position: hold while |q − θ| is [rad].
        velocity: hold while |q̇| is [rad/s].
    """

    product: Scalar | None = eqx.field(converter=optional_leaf, default=None)
    position: Scalar | None = eqx.field(converter=optional_leaf, default=None)
    velocity: Scalar | None = eqx.field(converter=optional_leaf, default=None)

    def __call__(self, swing: Swing, drive: Scalar) -> Bool[Array, ""]:
        """Return whether to hold."""
        bands = ((self.product, drive), (self.position, swing.deflection), (self.velocity, swing.velocity))
        holds = jnp.zeros_like(drive) > 0.0
        for band, value in bands:
            if band is not None:
                holds = holds | (jnp.abs(value) <= band)
        return holds


class SwitchState(NamedTuple):
    """The rule's state, and whether the last command was stiff (1) or soft (0)."""

    rule: Any
    is_stiff: Scalar


class StiffnessSwitch(AbstractController):
    """Switches between two stiffnesses by a rule; before anything moves it is stiff.

    Args:
        soft: k_min [N·m/rad].
        stiff: k_max [N·m/rad].
        rule: when to be stiff; law (23) by default.
        hold: when to keep the last command, or `None`.
    """

    soft: Scalar = eqx.field(converter=as_leaf)
    stiff: Scalar = eqx.field(converter=as_leaf)
    rule: AbstractRule = eqx.field(default_factory=Conic)
    hold: Hold | None = None

    def init(self, swing: Swing) -> SwitchState:
        """Return the state before the first instant."""
        return SwitchState(self.rule.init(swing), jnp.ones_like(swing.position))

    def step(self, state: SwitchState, swing: Swing) -> tuple[SwitchState, Command]:
        """Return the stiffness, with the motor at rest."""
        rule, drive = self.rule.step(state.rule, swing)
        keeps = drive == 0.0
        if self.hold is not None:
            keeps = keeps | self.hold(swing, drive)
        is_stiff = jnp.where(keeps, state.is_stiff, jnp.where(drive > 0.0, 1.0, 0.0))
        stiffness = jnp.where(is_stiff > 0.5, self.stiff, self.soft)
        return SwitchState(rule, is_stiff), Command(stiffness, jnp.zeros_like(swing.position))


class SmoothStiffness(AbstractController):
    """k = k_mid + ½Δk tanh(β s), with s the conic's drive over the swing's size: smooth, and alike for all swings.

    s = 2 (q + a q̇)(q̇ − c q) ω₀ / (ω₀² q² + q̇² + ε). With a = c = 0 its energy with every spring at k_mid never
    rises: V̇ = −b q̇² − ½Δk q q̇ tanh(β s) ≤ 0. At a slow actuator a small β does anticipation's job; at a fast one
    it tends to law (23) as β grows.

    Args:
        soft: k_min [N·m/rad].
        stiff: k_max [N·m/rad].
        sharpness: β.
        rate: ω₀, roughly the swing's [rad/s]; off by a factor of 2 it hardly matters.
        floor: ε, from which size on a swing counts [rad²/s²]; above 0 the law is smooth at rest.
        conic: a and c.
    """

    soft: Scalar = eqx.field(converter=as_leaf)
    stiff: Scalar = eqx.field(converter=as_leaf)
    sharpness: Scalar = eqx.field(converter=as_leaf)
    rate: Scalar = eqx.field(converter=as_leaf)
    floor: Scalar = eqx.field(converter=as_leaf, default=0.05)
    conic: Conic = eqx.field(default_factory=Conic)

    def init(self, swing: Swing) -> tuple[()]:
        """Return nothing: the law has no memory."""
        return ()

    def step(self, state: tuple[()], swing: Swing) -> tuple[tuple[()], Command]:
        """Return the stiffness, with the motor at rest."""
        size = (self.rate * swing.deflection) ** 2 + swing.velocity**2 + self.floor
        drive = 2.0 * self.rate * self.conic.drive(swing) / size
        middle, half = 0.5 * (self.soft + self.stiff), 0.5 * (self.stiff - self.soft)
        stiffness = middle + half * jnp.tanh(self.sharpness * drive)
        return state, Command(stiffness, jnp.zeros_like(swing.position))
