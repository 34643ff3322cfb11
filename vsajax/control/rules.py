"""When a joint should be stiff: rules on how it swings.

Each returns a drive: stiff where it is positive, soft where negative, as before where 0. The motor position is
constant here, so that the velocity of the deflection is that of the link.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool

from vsajax.types import RunningSum, Scalar, Swing, as_leaf


class AbstractRule(eqx.Module):
    """A rule that says when to be stiff."""

    @abstractmethod
    def init(self, swing: Swing) -> Any:
        """Return the state before the first instant."""

    @abstractmethod
    def step(self, state: Any, swing: Swing) -> tuple[Any, Scalar]:
        """Return (state, drive)."""


class Conic(AbstractRule):
    """Stiff where (q + a q̇)(q̇ − c q) > 0: law (23) of Gasparri et al. with its two switching lines tilted.

    With a = c = 0 it is law (23), stiff on the way out and soft on the way back. Printed Remark 1, "k_max if
    q̈ < 0", is wrong for q̇ < 0: it is stiff where q̇ q̈ < 0.

    Positive a and c anticipate, for an actuator that takes its time: a, near half its travel time, switches to
    stiff before the centre; c, near ω² times that, to soft before the peak. Negative c keeps the joint stiff past
    the peak, which is what damps fastest with an instant actuator (`switching.best_release`). Both lines go
    through the origin: the rule is the same for large and small swings.

    Args:
        lead: a [s].
        slope: c [1/s].
    """

    lead: Scalar = eqx.field(converter=as_leaf, default=0.0)
    slope: Scalar = eqx.field(converter=as_leaf, default=0.0)

    def init(self, swing: Swing) -> tuple[()]:
        """Return nothing: the rule has no memory."""
        return ()

    def step(self, state: tuple[()], swing: Swing) -> tuple[tuple[()], Scalar]:
        """Return the product [rad²/s]."""
        return state, self.drive(swing)

    def drive(self, swing: Swing) -> Scalar:
        """Return (q + a q̇)(q̇ − c q) [rad²/s]."""
        q, v = swing.deflection, swing.velocity
        return (q + self.lead * v) * (v - self.slope * q)


class TimeLead(AbstractRule):
    """Law (23) on what deflection and velocity will be: sign of (q + τ_x q̇)(q̇ + τ_v q̈).

    It needs an acceleration, which noise spoils first.

    Args:
        position_lead: τ_x [s].
        velocity_lead: τ_v [s].
    """

    position_lead: Scalar = eqx.field(converter=as_leaf)
    velocity_lead: Scalar = eqx.field(converter=as_leaf)

    def init(self, swing: Swing) -> tuple[()]:
        """Return nothing: the rule has no memory."""
        return ()

    def step(self, state: tuple[()], swing: Swing) -> tuple[tuple[()], Scalar]:
        """Return the product [rad²/s]."""
        ahead = swing.deflection + self.position_lead * swing.velocity
        return state, ahead * (swing.velocity + self.velocity_lead * swing.acceleration)


class PeakState(NamedTuple):
    """The largest |q| [rad] and |q̇| [rad/s] since each last changed sign, and their values before."""

    position_peak: Scalar
    velocity_peak: Scalar
    position: Scalar
    velocity: Scalar


class FixedThresholds(AbstractRule):
    """The paper's anticipation: soft once |q̇| < v_th on the way out, stiff once |q| < q_th on the way back.

    Below its thresholds it is law (23) inverted, which pumps energy in: the joint ends in a limit cycle. With
    `falls_back` it is law (23) itself once both last peaks are below twice the thresholds, which makes the cycle
    smaller and does not end it.

    Args:
        position: q_th [rad].
        velocity: v_th [rad/s].
        falls_back: see above.
    """

    position: Scalar = eqx.field(converter=as_leaf)
    velocity: Scalar = eqx.field(converter=as_leaf)
    falls_back: bool = eqx.field(static=True, default=False)

    def init(self, swing: Swing) -> PeakState:
        """Return the state before the first swing."""
        return _first_peaks(swing)

    def step(self, state: PeakState, swing: Swing) -> tuple[PeakState, Scalar]:
        """Return ±1."""
        state = _follow_peaks(state, swing)
        position, velocity = self.position, self.velocity
        if self.falls_back:
            is_small = (state.position_peak < 2.0 * position) & (state.velocity_peak < 2.0 * velocity)
            position, velocity = jnp.where(is_small, 0.0, position), jnp.where(is_small, 0.0, velocity)
        return state, _threshold_drive(swing, position, velocity)


class HeldPeakState(NamedTuple):
    """The peaks of this half-swing, and those of the one before: |q| [rad], |q̇| [rad/s]."""

    now: PeakState
    position_before: Scalar
    velocity_before: Scalar


class RelativeThresholds(AbstractRule):
    """The same with thresholds that are shares of the last peaks: q_th = α |q|_peak, v_th = β |q̇|_peak.

    The last peak is the larger of this half-swing's so far and of the whole one before it; a half-swing of q ends
    where q changes its sign, one of q̇ where q̇ does. It treats large and small swings alike, but noise makes peaks.

    Args:
        position_share: α.
        velocity_share: β.
    """

    position_share: Scalar = eqx.field(converter=as_leaf)
    velocity_share: Scalar = eqx.field(converter=as_leaf)

    def init(self, swing: Swing) -> HeldPeakState:
        """Return the state before the first swing."""
        zero = jnp.zeros_like(swing.deflection)
        return HeldPeakState(_first_peaks(swing), zero, zero)

    def step(self, state: HeldPeakState, swing: Swing) -> tuple[HeldPeakState, Scalar]:
        """Return ±1."""
        last, now = state.now, _follow_peaks(state.now, swing)
        state = HeldPeakState(
            now,
            jnp.where(last.position * now.position < 0.0, last.position_peak, state.position_before),
            jnp.where(last.velocity * now.velocity < 0.0, last.velocity_peak, state.velocity_before),
        )
        position = self.position_share * jnp.maximum(now.position_peak, state.position_before)
        velocity = self.velocity_share * jnp.maximum(now.velocity_peak, state.velocity_before)
        return state, _threshold_drive(swing, position, velocity)


class ReleaseState(NamedTuple):
    """Where in its swing a joint is.

    Args:
        position: at the last instant [rad].
        is_leaving: 1 from the centre to the peak, else 0.
        way_out: how long it has been, or was, on its way from the centre to the peak [s].
        since_peak: [s].
    """

    position: Scalar
    is_leaving: Scalar
    way_out: RunningSum
    since_peak: RunningSum


class DelayedRelease(AbstractRule):
    """Law (23), but stiff for a while after the peak: a share of the time that the way out took.

    Law (23) is an extremal of its cost, not the fastest damping. Staying stiff past the peak is faster, by a phase
    that depends on k_min/k_max alone (`switching.best_release`); as a share of the time from the centre to the
    peak, a quarter period at k_max, it needs neither inertia nor friction, which makes it as free of a model as
    law (23) is. It is for actuators that are much faster than the swing.

    Args:
        share: of the way out; 0 is law (23).
    """

    share: Scalar = eqx.field(converter=as_leaf)

    def init(self, swing: Swing) -> ReleaseState:
        """Return the state of a joint that is about to leave the centre."""
        zero = jnp.zeros_like(swing.position)
        return ReleaseState(swing.deflection, zero + 1.0, zero, zero)

    def step(self, state: ReleaseState, swing: Swing) -> tuple[ReleaseState, Scalar]:
        """Return ±1."""
        q, v, dt = swing.deflection, swing.velocity, swing.dt
        has_crossed = q * state.position < 0.0
        # Crossings lie between samples: a linear share of the step belongs to the new side.
        past = dt * jnp.abs(q) / jnp.where(has_crossed, jnp.abs(q - state.position), 1.0)
        is_leaving = has_crossed | (state.is_leaving > 0.0)
        has_turned = is_leaving & (q * v < 0.0)
        way_out = jnp.where(has_crossed, past, state.way_out + dt * is_leaving)
        still = is_leaving & ~has_turned
        since_peak = jnp.where(still | has_turned, 0.0, state.since_peak + dt)
        is_stiff = still | (since_peak < self.share * way_out)
        state = ReleaseState(q, still * jnp.ones_like(q), way_out, since_peak)
        return state, jnp.where(is_stiff, 1.0, -1.0)


def _first_peaks(swing: Swing) -> PeakState:
    return PeakState(jnp.abs(swing.deflection), jnp.abs(swing.velocity), swing.deflection, swing.velocity)


def _follow_peaks(state: PeakState, swing: Swing) -> PeakState:
    q, v = swing.deflection, swing.velocity

    def follow(peak: Scalar, last: Scalar, now: Scalar) -> Scalar:
        return jnp.where(now * last < 0.0, jnp.abs(now), jnp.maximum(peak, jnp.abs(now)))

    return PeakState(
        follow(state.position_peak, state.position, q),
        follow(state.velocity_peak, state.velocity, v),
        q,
        v,
    )


def _threshold_drive(swing: Swing, position: Scalar, velocity: Scalar) -> Scalar:
    q, v = swing.deflection, swing.velocity
    is_leaving: Bool[Array, ""] = q * v > 0.0
    is_stiff = jnp.where(is_leaving, jnp.abs(v) >= velocity, jnp.abs(q) < position)
    return jnp.where(q * v == 0.0, 0.0, jnp.where(is_stiff, 1.0, -1.0))
