"""Recursive least squares, and what its posterior says about an estimate.

Letters of Flacco et al., IROS 2011: F features, η coefficients, P covariance, ρ = FᵀPF, K = PF/(1 + ρ),
ε innovation, a stability factor, c its constant.

The enhanced RLS (25)–(27) is ordinary RLS: with a = (c + cρ)/(1 + cρ), a·K = cPF/(1 + cρ), so P' = cP follows
(14) from P'(0) = c·P(0). c and P(0) are one hyperparameter, the prior scale κ = c·P(0), and the estimate is
ridge regression with λ = 1/κ. `UnitFactor` is that well-conditioned form; `EnhancedFactor` is the printed one.

P, K and ρ depend on features and prior alone, never on the torque. Under nested `vmap` they are therefore
computed once for every torque-only hyperparameter and torque-noise draw; the recursion below keeps that so.

Derivatives in the prior have a closed form where the fit is ridge regression: with P⁻¹ = I/κ + Σ F Fᵀ and η = P b,
∂P/∂κ = P²/κ² and ∂η/∂κ = P η/κ². What is read off the fit carries it, and the recursion none: P then has no
derivative at all where the features have none.

The innovations of a lagging torque are correlated from sample to sample, and the mean of many of them varies by
their slow part alone. So the noise is estimated from overlapping batch means: running averages m of the normalised
innovations e over several times as long as they are correlated. Were e white with variance 1, m would have the
variance v(k) = (1 − b)² v(k−1) + b², where b is the newest innovation's share. Σm²/Σv is then the variance of e
where e is white, and its spectral density at zero frequency where it is correlated. Σv counts averages that share
no innovation.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from vsajax.numerics import (
    Matrix,
    Vector,
    dot,
    lanes_minor,
    once,
    rank_one_downdate,
    scaled_symmetric_part,
    sum_of_squares,
    symmetric_product,
    trace,
    with_slope,
)
from vsajax.types import RunningSum, Scalar, as_leaf, require_float64

_OVERFLOW = 1e30
"""Leverage from which a sample's features are not used; its root bounds the innovation, whose square is summed."""
_OVERFLOW_ROOT = 1e15
_AVERAGES = 20.0
"""Averages, none sharing an innovation, that the noise is estimated from where coefficients remember fewer."""


def blend_over(dt: Scalar, time: Scalar | float) -> Scalar:
    """Return the share of a sample in a running average over `time` [s], `dt` [s] after the last one."""
    return dt / (time + dt)


class Step(NamedTuple):
    """How a gain law weights a sample.

    Args:
        factor: a.
        spread: the innovation's variance in units of the noise variance, 1 + ρ in the posterior's own scale.
    """

    factor: Scalar
    spread: Scalar


class AbstractGainLaw(eqx.Module):
    """How strongly each sample is used."""

    @abstractmethod
    def __call__(self, leverage: Scalar) -> Step:
        """Return the weights of a sample with leverage ρ."""

    @abstractmethod
    def posterior_scale(self) -> Scalar:
        """Return what turns P into a posterior covariance in units of the noise variance; NaN if nothing does."""

    @abstractmethod
    def memory(self) -> Scalar | None:
        """Return λ, by which the weight of past samples shrinks with each; `None` where nothing is forgotten."""

    @property
    @abstractmethod
    def is_ridge(self) -> bool:
        """Whether P is (I/κ + Σ F Fᵀ)⁻¹ with κ the prior scale."""


class UnitFactor(AbstractGainLaw):
    """a = 1: ordinary RLS (14)."""

    def __call__(self, leverage: Scalar) -> Step:
        """Return a = 1."""
        return Step(jnp.ones_like(leverage), 1.0 + leverage)

    def posterior_scale(self) -> Scalar:
        """P is the posterior covariance itself."""
        return jnp.ones(())

    def memory(self) -> None:
        """Nothing is forgotten."""
        return None

    @property
    def is_ridge(self) -> bool:
        """The recursion is ridge regression."""
        return True


class EnhancedFactor(AbstractGainLaw):
    """a(k) = (c + cρ)/(1 + cρ), (27), as printed.

    Args:
        constant: c > 0.
    """

    constant: Scalar = eqx.field(converter=as_leaf)

    def __call__(self, leverage: Scalar) -> Step:
        """Return a(k)."""
        scaled = self.constant * leverage
        return Step((self.constant + scaled) / (1.0 + scaled), 1.0 + scaled)

    def posterior_scale(self) -> Scalar:
        """c·P is the posterior covariance."""
        return self.constant

    def memory(self) -> None:
        """Nothing is forgotten."""
        return None

    @property
    def is_ridge(self) -> bool:
        """With P(0) for κ, c scales the data."""
        return False


class ConstantFactor(AbstractGainLaw):
    """a(k) = a in (25): Fig. 8's comparison.

    It is least squares with weights a/(1 + ρ − aρ) that follow the leverage, not the noise, so P is no posterior.

    Args:
        factor: 0 < a ≤ 1.
    """

    factor: Scalar = eqx.field(converter=as_leaf)

    def __call__(self, leverage: Scalar) -> Step:
        """Return a."""
        return Step(self.factor + jnp.zeros_like(leverage), 1.0 + leverage)

    def posterior_scale(self) -> Scalar:
        """No multiple of P is a posterior."""
        return jnp.full((), jnp.nan)

    def memory(self) -> None:
        """Nothing is forgotten."""
        return None

    @property
    def is_ridge(self) -> bool:
        """The weights follow the leverage."""
        return False


class ExponentialForgetting(AbstractGainLaw):
    """Ordinary RLS in which a sample's weight shrinks by λ with every later one.

    P is divided by λ before each sample: with ρ = FᵀPF of that P it is the textbook K = PF/(λ + FᵀPF). What is
    forgotten of the data is given back to the prior, so that a direction which no sample excites grows to the
    prior and not beyond it: P⁻¹ ← λ P⁻¹ + (1 − λ) I/κ. One coefficient has its d-fold turn at each sample, in the
    order of the basis, which is that on average and costs no inverse. The coefficients stay where they are.

    Args:
        forgetting: λ, 0 < λ ≤ 1; the memory is about 1/(1 − λ) samples.
    """

    forgetting: Scalar = eqx.field(converter=as_leaf)

    def __call__(self, leverage: Scalar) -> Step:
        """Return a = 1."""
        return Step(jnp.ones_like(leverage), 1.0 + leverage)

    def posterior_scale(self) -> Scalar:
        """P is the posterior covariance itself."""
        return jnp.ones(())

    def memory(self) -> Scalar:
        """Return λ."""
        return self.forgetting

    @property
    def is_ridge(self) -> bool:
        """Forgetting weighs the samples."""
        return False


class FitState(NamedTuple):
    """Coefficients η, covariance P, and what is known of the noise.

    Args:
        coefficients: η.
        covariance: P.
        average: m, of the normalised innovations e = ε/√spread over the time for which they are correlated.
        average_variance: v, the variance that m would have, were e white with variance 1.
        squares: Σ m².
        freedom: Σ v, the number of averages in memory that share no innovation.
        weight: Σ 1, the number of samples in memory.
        target: the last one.
        turn: 1 at the coefficient whose prior is next given back, else 0; `None` where nothing is forgotten.
    """

    coefficients: Vector
    covariance: Matrix
    average: Scalar
    average_variance: Scalar
    squares: RunningSum
    freedom: RunningSum
    weight: RunningSum
    target: Scalar
    turn: Vector | None = None


class RecursiveLeastSquares(eqx.Module):
    """Recursive least squares from zero coefficients and covariance prior_scale · I.

    Args:
        prior_scale: κ, or P(0) with the printed `EnhancedFactor` and with `ConstantFactor`.
        law: how strongly each sample is used.
        band: factor on the answers' standard deviation: 1, or the one with which the band held the truth of
            simulated scenarios as often as it says.
    """

    prior_scale: Scalar = eqx.field(converter=as_leaf)
    law: AbstractGainLaw = eqx.field(default_factory=UnitFactor)
    band: Scalar = eqx.field(converter=as_leaf, default=1.0)

    def init(self, size: int) -> FitState:
        """Return the state before the first sample, for `size` features.

        Raises:
            PrecisionError: double precision is off.
        """
        require_float64("recursive least squares")
        zero = jnp.zeros_like(self.prior_scale)
        scale = jax.lax.stop_gradient(self.prior_scale) if self.law.is_ridge else self.prior_scale
        covariance = lanes_minor(scale * jnp.eye(size, dtype=scale.dtype))
        turn = None if self.law.memory() is None else jnp.zeros(size).at[0].set(1.0)
        coefficients = lanes_minor(jnp.full((size,), zero))
        return FitState(coefficients, covariance, zero, zero, zero, zero, zero, zero, turn)

    def step(
        self,
        state: FitState,
        features: Vector,
        target: Scalar,
        *,
        blend: Scalar | float = 1.0,
        share: Scalar | float = 1.0,
    ) -> tuple[FitState, Scalar]:
        """Use one sample; return (state, stability factor a).

        Features whose leverage is no number, negative, or overflows, change nothing; an innovation that overflows
        changes no coefficient. One that is no number makes them NaN: whatever feeds the fit has diverged, and P,
        which the torque has no say in, would go on to claim more and more.

        Args:
            state: of the last sample.
            features: F, already weighted.
            target: of the features, weighted as they are.
            blend: b, the sample's share in the running average of the innovations, see `blend_over`; 1 takes them
                for independent of each other.
            share: how much of a sample it is, from 0 to 1, in the count of them.
        """
        covariance, memory = self._forgotten(state)
        column = symmetric_product(covariance, features)
        leverage = dot(features, column)
        # Powers of a reading that is absurd but finite overflow, in single precision sooner. NaN compares false.
        # The torque must have no say in what becomes of P, so an absurd one is kept out further below.
        # Nor is one used where rounding has left of a badly scaled P nothing positive: P would grow without bound.
        is_usable = once((leverage >= 0.0) & (leverage < _OVERFLOW))
        column = jnp.where(is_usable, column, 0.0)
        leverage = jnp.where(is_usable, leverage, 0.0)
        factor, spread = self.law(leverage)
        gain = once(factor / (1.0 + leverage))
        innovation = target - dot(features, state.coefficients)
        is_left_out = jnp.logical_not(is_usable) | (jnp.abs(innovation) >= _OVERFLOW_ROOT)
        innovation = once(jnp.where(is_left_out, 0.0, innovation))
        correction = once(gain * innovation)
        spread = self._with_prior(spread, lambda: dot(column, column))
        seen = self._with_prior(innovation, lambda: -dot(column, state.coefficients))
        normalised = once(seen * once(1.0 / jnp.sqrt(spread)))
        # What repeats itself to the last digit stands still, or is broken: it says nothing of the noise.
        is_heard = is_usable & (target != state.target)
        heard = jnp.where(is_heard, share, 0.0)
        blend = once(blend * heard)
        average = state.average + blend * (normalised - state.average)
        average_variance = (1.0 - blend) ** 2 * state.average_variance + blend * blend
        squares, freedom, weight = state.squares, state.freedom, state.weight
        if memory is not None:
            kept = jnp.where(is_heard, jnp.maximum(memory, 1.0 - blend / (2.0 * _AVERAGES)), 1.0)
            squares, freedom, weight = kept * squares, kept * freedom, memory * weight
        state = FitState(
            lanes_minor(state.coefficients + correction * column),
            rank_one_downdate(covariance, column, gain),
            average,
            average_variance,
            squares + heard * average * average,
            freedom + heard * average_variance,
            weight + jnp.where(is_usable, share, 0.0),
            target,
            None if state.turn is None else jnp.roll(state.turn, 1),
        )
        return state, factor

    def predict(self, state: FitState, direction: Vector) -> Scalar:
        """Return directionᵀη."""
        value = dot(direction, state.coefficients)
        return self._with_prior(
            value, lambda: dot(symmetric_product(state.covariance, direction), state.coefficients)
        )

    def variance(self, state: FitState, direction: Vector, pull: Vector | None = None) -> Scalar:
        """Return the posterior variance of directionᵀη.

        Var = band² (s² · directionᵀ P' direction + (directionᵀ P' pull)²), with the noise
        s² = Σm² / (ν − 1) of the innovations' averages, of which ν = Σv · (N − d)/N are neither shared nor fitted.
        As they overlap, the sum has 2ν degrees of freedom, and 2ν/(2ν − 2) makes it the variance of Student's
        distribution: wide where they are few. Infinite while ν ≤ 1, and wherever the number would not be positive:
        rounding has then left nothing of P in this direction, or every innovation was 0 and nothing was measured.

        Args:
            state: after the last sample.
            direction: of which combination of coefficients.
            pull: Σ E[n²] F′F′ᵀη of features with errors, see `attenuation`; nothing where they are exact.
        """
        column = symmetric_product(state.covariance, direction)
        spread = self._with_prior(dot(direction, column), lambda: dot(column, column)) * self.law.posterior_scale()
        unfitted = 1.0 - len(direction) / jnp.maximum(state.weight, 1.0)
        freedom = state.freedom * unfitted - 1.0
        variance = spread * state.squares / jnp.where(freedom > 0.0, freedom, 1.0)
        is_positive = (unfitted > 0.0) & (freedom > 0.0) & ~(variance <= 0.0)
        if pull is not None:
            leaning = self._with_prior(
                dot(column, pull), lambda: dot(column, symmetric_product(state.covariance, pull))
            )
            variance = variance + (self.law.posterior_scale() * leaning) ** 2
        variance = self.band**2 * variance
        return jnp.where(is_positive, variance, jnp.inf)

    def determined(self, state: FitState) -> Scalar:
        """Return the effective degrees of freedom d − tr(P)/κ, the trace of the ridge regression's hat matrix.

        A coefficient counts 1 once the data fix it, and 0 while it is what the prior says. With forgetting the
        covariance of a direction that is no longer excited may outgrow its own prior; the count stops at 0.
        """
        undetermined = self._with_prior(trace(state.covariance), lambda: sum_of_squares(state.covariance))
        return jnp.maximum(state.covariance.shape[0] - undetermined / self.prior_scale, 0.0)

    def _forgotten(self, state: FitState) -> tuple[Matrix, Scalar | None]:
        """Return P as the next sample finds it, and λ."""
        memory = self.law.memory()
        if memory is None or state.turn is None:
            return state.covariance, None
        # The downdate is symmetric and leaves what rounding makes asymmetric; inflated at every sample, that
        # would outgrow P within some 37/(1 − λ) samples.
        covariance = scaled_symmetric_part(state.covariance, 1.0 / memory)
        column = symmetric_product(covariance, state.turn)
        information = (1.0 - memory) * len(state.turn) / self.prior_scale
        gain = once(information / (1.0 + information * dot(state.turn, column)))
        return rank_one_downdate(covariance, column, gain), memory

    def _with_prior(self, value: Scalar, slope: Callable[[], Scalar]) -> Scalar:
        """Return `value`, its derivative in κ being `slope` / κ² where the fit is ridge regression."""
        if not self.law.is_ridge:
            return value
        return with_slope(value, slope() / self.prior_scale**2, self.prior_scale)
