"""The algebraic observer of Ménard, Grioli, Bicchi: the motor equation in weak form, then recursive least squares.

Tested against −g′ over a moving window, the motor equation needs no velocity:

    C(t) = ∫₀¹ [−J g‴ + T b g″] q du + T² ∫₀¹ g′ τ du = −T² ∫₀¹ g′ f(φ) du,

so with f = Σ ηⱼ Fⱼ the windowed features Bⱼ = −T² ∫ g′ Fⱼ du regress C. Printed (16), (17), (20) have the opposite
sign, (21) reads the window forwards, (26) and (28) flip it; see docs/antagonistic-joint.md. A geared motor enters
with J = Bγ², b = Dγ² and γτ. Whatever the window says of the torque's constant part is lost: ∫ g′ = 0.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from vsajax.estimators import windows
from vsajax.estimators.base import AbstractEstimator, Prepared
from vsajax.estimators.bases import AbstractBasis
from vsajax.estimators.gate import ExcitationGate, GateState
from vsajax.estimators.rls import FitState, RecursiveLeastSquares, blend_over
from vsajax.estimators.velocity import AbstractVelocityFilter
from vsajax.numerics import Vector, lanes_minor, once, safe_sqrt
from vsajax.types import Estimate, RunningSum, Sample, Scalar, Signals, as_leaf

_WHOLE = 1.0 - 1e-6
"""Above it a window is complete: T/T_s rounds."""
_WINDOWS = 0.5
"""Windows over which innovations are averaged."""


class Regression(NamedTuple):
    """One row of the regression, and the sample it belongs to.

    Args:
        sample: the newest sample of the window.
        target: C.
        features: B.
        share: weight of the row in the fit: 1 once the whole window lies within the recording, or may be taken to;
            0 before; between the two at the sample where the window just fits, so that the fit is continuous in T.
    """

    sample: Sample
    target: Float[Array, "..."]
    features: tuple[Float[Array, "..."], ...]
    share: Float[Array, "..."]


class FitStage(NamedTuple):
    """State of all that follows the window."""

    fit: FitState
    gate: GateState
    motor: Any
    link: Any


class RingState(NamedTuple):
    """The samples in the window, newest first, and the number of samples so far."""

    positions: Float[Array, " taps"]
    torques: Float[Array, " taps"]
    features: Float[Array, "taps d"]
    seen: RunningSum
    stage: FitStage


class AlgebraicObserver(AbstractEstimator):
    """Windowed regression of one transmission; see the module.

    Args:
        motor_inertia: B, of the rotor [kg·m²].
        motor_damping: D, on the motor axis [N·m·s/rad].
        window: T [s]; real, and differentiable with product quadrature. The others round it to samples.
        basis: features of the elastic torque.
        fit: the recursive fit.
        gear_ratio: γ.
        gate: when the answer is known.
        velocity: filters the positions at which stiffness is evaluated; `None` evaluates at the readings.
        sample_time: T_s of the recordings [s]; they must be regular.
        longest_window: for which the window's taps are laid out [s]; T must not exceed it.
        quadrature: of the window; see `windows.impulse_response`.
        weighting: "sample" gives each sample weight 1; "continuous" weight T_s, the exact discretisation of
            (23)–(24) over a sample. "sample" with P(0) is "continuous" with P(0)/T_s.
        scaling: "printed", the equation above; or "scale_free": both sides divided by T² ‖g′‖ and each sample
            weighted T_s/T, so that a prior scale keeps its meaning when T, T_s or the basis' units change.
        start: "window", the fit waits until the window is full (a window that lacks less than a sample counts in
            part, its missing end held at the first reading); "zeros", as if all signals had been zero before;
            "rest", as if they had been at their first values. Zeros are wrong for a joint that starts elsewhere.
    """

    motor_inertia: Scalar = eqx.field(converter=as_leaf)
    motor_damping: Scalar = eqx.field(converter=as_leaf)
    window: Scalar = eqx.field(converter=as_leaf)
    basis: AbstractBasis
    fit: RecursiveLeastSquares
    gear_ratio: Scalar = eqx.field(converter=as_leaf, default=1.0)
    gate: ExcitationGate = eqx.field(default_factory=ExcitationGate)
    velocity: AbstractVelocityFilter | None = None
    sample_time: float = eqx.field(static=True, default=1e-3)
    longest_window: float = eqx.field(static=True, default=1.0)
    quadrature: windows.Quadrature = eqx.field(static=True, default="product")
    weighting: Literal["sample", "continuous"] = eqx.field(static=True, default="sample")
    scaling: Literal["printed", "scale_free"] = eqx.field(static=True, default="printed")
    start: Literal["window", "zeros", "rest"] = eqx.field(static=True, default="window")

    @property
    def needs(self) -> frozenset[str]:
        """Names of the signals that a recording must have."""
        setpoint = {"setpoint_position"} if self.basis.uses_setpoint else set()
        return frozenset({"link_position", "motor_position", "motor_torque"} | setpoint)

    @property
    def taps(self) -> int:
        """Number of samples in the longest window."""
        return windows.taps_of(self.longest_window, self.sample_time)

    @property
    def _span(self) -> Scalar:
        """The window that the quadrature covers [s]."""
        return windows.span_of(self.window, sample_time=self.sample_time, quadrature=self.quadrature)

    def init(self, sample: Sample) -> RingState:
        """Return the state before the first sample, which `step` then processes as any other."""
        position, torque, features = self._signals(sample)
        held = 0.0 if self.start == "zeros" else 1.0
        full = jnp.ones(self.taps)
        return RingState(
            held * position * full,
            held * torque * full,
            held * full[:, None] * features,
            jnp.zeros_like(position),
            self._start(sample),
        )

    def step(self, state: RingState, sample: Sample) -> tuple[RingState, Estimate]:
        """Process one sample; return (state, estimate)."""
        position, torque, features = self._signals(sample)
        positions = _push(state.positions, position)
        torques = _push(state.torques, torque)
        rows = _push(state.features, features)
        on_position, on_torque, on_features = self._responses()
        seen = state.seen + 1.0
        regression = Regression(
            sample,
            jnp.sum(on_position * positions) + jnp.sum(on_torque * torques),
            tuple(jnp.sum(on_features * rows[:, j]) for j in range(self.basis.size)),
            self._share(seen),
        )
        stage, estimate = self._fit(state.stage, regression)
        return RingState(positions, torques, rows, seen, stage), estimate

    def offline(self, samples: Sample) -> Prepared:
        """Return the regression of a whole recording, its windows taken by fast convolution."""
        position, torque, features = jax.vmap(self._signals)(samples)
        on_position, on_torque, on_features = self._responses()

        def from_rest(signal: Array) -> Array:
            # The kernels' integrals vanish: with zeros before, a signal less its first value is one at rest.
            return signal if self.start == "zeros" else signal - signal[0]

        count = jnp.arange(1, position.shape[0] + 1, dtype=position.dtype)
        rows = Regression(
            samples,
            windows.convolve((on_position, on_torque), (from_rest(position), from_rest(torque))),
            tuple(windows.convolve((on_features,), (from_rest(feature),)) for feature in features.T),
            self._share(count),
        )
        return Prepared(self._start(jax.tree.map(lambda x: x[0], samples)), rows, self._fit)

    def _signals(self, sample: Sample) -> tuple[Scalar, Scalar, Vector]:
        """Return the joint-side motor position and torque, and the features."""
        position = sample.read("motor_position")
        deflection = sample.read("link_position") - position
        setpoint = sample.read("setpoint_position") if self.basis.uses_setpoint else jnp.zeros_like(deflection)
        return position, self.gear_ratio * sample.read("motor_torque"), self.basis(setpoint, deflection)[0]

    def _responses(self) -> tuple[Array, Array, Array]:
        """Return the filters of position, torque and features."""
        window = self._span
        first, second, third = (
            windows.impulse_response(
                kernel, window, sample_time=self.sample_time, taps=self.taps, quadrature=self.quadrature
            )
            for kernel in (windows.FIRST, windows.SECOND, windows.THIRD)
        )
        square = self.gear_ratio**2
        on_position = square * (window * self.motor_damping * second - self.motor_inertia * third)
        on_torque = window**2 * first
        scale = 1.0 / (window**2 * windows.FIRST_NORM) if self.scaling == "scale_free" else 1.0
        return scale * on_position, scale * on_torque, -scale * on_torque

    def _share(self, count: Array) -> Array:
        if self.start != "window":
            return jnp.ones_like(count)
        # Not `clip`, whose derivative at whole samples is the mean of both sides.
        surplus = count - self._span / self.sample_time
        return jnp.where(surplus > 1.0, 1.0, jnp.maximum(surplus, 0.0))

    def _start(self, sample: Sample) -> FitStage:
        position, link = sample.read("motor_position"), sample.read("link_position")
        return FitStage(
            fit=self.fit.init(self.basis.size),
            gate=self.gate.init(link - position),
            motor=None if self.velocity is None else self.velocity.init(position),
            link=None if self.velocity is None else self.velocity.init(link),
        )

    def _fit(self, state: FitStage, row: Regression) -> tuple[FitStage, Estimate]:
        sample = row.sample
        motor, link = state.motor, state.link
        position, link_position = sample.read("motor_position"), sample.read("link_position")
        velocity = jnp.zeros_like(position)
        if self.velocity is not None:
            motor, (position, velocity) = self.velocity.step(motor, position, sample.dt)
            link, (link_position, _) = self.velocity.step(link, link_position, sample.dt)
        deflection = link_position - position
        weight = safe_sqrt(row.share)
        if self.scaling == "scale_free":
            weight = weight * jnp.sqrt(self.sample_time / self._span)
        elif self.weighting == "continuous":
            weight = weight * jnp.sqrt(self.sample_time)
        regressors = lanes_minor(weight * jnp.stack(row.features))
        # The empty rows of an incomplete window are no samples: counted, they would make the first answers look
        # certain. Rows share samples for as long as the window.
        blend = blend_over(sample.dt, _WINDOWS * self._span)
        fit, factor = self.fit.step(state.fit, regressors, weight * row.target, blend=blend, share=row.share)
        setpoint = sample.read("setpoint_position") if self.basis.uses_setpoint else jnp.zeros_like(deflection)
        features, slopes = once(self.basis(setpoint, deflection))
        stiffness = once(self.fit.predict(fit, slopes))
        std = once(jnp.sqrt(self.fit.variance(fit, slopes)))
        gate, known = self.gate.step(state.gate, deflection, stiffness, std)
        torque = self.fit.predict(fit, features)
        known = known & (row.share > _WHOLE)
        signals = Signals(deflection, torque, velocity, factor, self.fit.determined(fit))
        return FitStage(fit, gate, motor, link), Estimate(stiffness, std, torque, known, signals)


def _push(buffer: Array, newest: Array) -> Array:
    return jnp.concatenate([newest[None], buffer[:-1]])
