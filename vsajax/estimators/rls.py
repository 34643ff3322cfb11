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


class Step(NamedTuple):
    """How a gain law weights a sample.

    Args:
        factor: a.
        inflation: what P is multiplied by after the sample, 1/λ when forgetting; `None` without forgetting.
        spread: the innovation's variance in units of the noise variance, 1 + ρ in the posterior's own scale.
    """

    factor: Scalar
    inflation: Scalar | None
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
    def memory(self) -> Scalar:
        """Return by how much the weight of past innovations shrinks each sample."""

    @property
    @abstractmethod
    def is_ridge(self) -> bool:
        """Whether P is (I/κ + Σ F Fᵀ)⁻¹ with κ the prior scale."""


class UnitFactor(AbstractGainLaw):
    """a = 1: ordinary RLS (14)."""

    def __call__(self, leverage: Scalar) -> Step:
        """Return a = 1, no inflation."""
        return Step(jnp.ones_like(leverage), None, 1.0 + leverage)

    def posterior_scale(self) -> Scalar:
        """P is the posterior covariance itself."""
        return jnp.ones(())

    def memory(self) -> Scalar:
        """Nothing is forgotten."""
        return jnp.ones(())

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
        """Return a(k), no inflation."""
        scaled = self.constant * leverage
        return Step((self.constant + scaled) / (1.0 + scaled), None, 1.0 + scaled)

    def posterior_scale(self) -> Scalar:
        """c·P is the posterior covariance."""
        return self.constant

    def memory(self) -> Scalar:
        """Nothing is forgotten."""
        return jnp.ones(())

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
        """Return a, no inflation."""
        return Step(self.factor + jnp.zeros_like(leverage), None, 1.0 + leverage)

    def posterior_scale(self) -> Scalar:
        """No multiple of P is a posterior."""
        return jnp.full((), jnp.nan)

    def memory(self) -> Scalar:
        """Nothing is forgotten."""
        return jnp.ones(())

    @property
    def is_ridge(self) -> bool:
        """The weights follow the leverage."""
        return False


class ExponentialForgetting(AbstractGainLaw):
    """Ordinary RLS in which a sample's weight shrinks by λ with every later one.

    With ρ = FᵀPF of the inflated P this is the textbook K = PF/(λ + FᵀPF), P ← (P − K FᵀP)/λ.

    Args:
        forgetting: λ, 0 < λ ≤ 1; the memory is about 1/(1 − λ) samples.
    """

    forgetting: Scalar = eqx.field(converter=as_leaf)

    def __call__(self, leverage: Scalar) -> Step:
        """Return a = 1 and the inflation 1/λ."""
        return Step(jnp.ones_like(leverage), jnp.ones_like(leverage) / self.forgetting, 1.0 + leverage)

    def posterior_scale(self) -> Scalar:
        """λ·P is the covariance after the last sample: P is kept as the prior of the next one."""
        return self.forgetting

    def memory(self) -> Scalar:
        """Return λ."""
        return self.forgetting

    @property
    def is_ridge(self) -> bool:
        """Forgetting weighs the samples."""
        return False


class FitState(NamedTuple):
    """Coefficients η, covariance P, and running sums of the normalised innovations e = ε/√spread.

    Args:
        coefficients: η.
        covariance: P.
        squares: Σ e².
        products: Σ e(k) e(k−1).
        weight: Σ 1, the number of samples in memory.
        last: e(k−1).
    """

    coefficients: Vector
    covariance: Matrix
    squares: RunningSum
    products: RunningSum
    weight: RunningSum
    last: Scalar


class RecursiveLeastSquares(eqx.Module):
    """Recursive least squares from zero coefficients and covariance prior_scale · I.

    Args:
        prior_scale: κ, or P(0) with the printed `EnhancedFactor` and with `ConstantFactor`.
        law: how strongly each sample is used.
    """

    prior_scale: Scalar = eqx.field(converter=as_leaf)
    law: AbstractGainLaw = eqx.field(default_factory=UnitFactor)

    def init(self, size: int) -> FitState:
        """Return the state before the first sample, for `size` features.

        Raises:
            PrecisionError: double precision is off.
        """
        require_float64("recursive least squares")
        zero = jnp.zeros_like(self.prior_scale)
        scale = jax.lax.stop_gradient(self.prior_scale) if self.law.is_ridge else self.prior_scale
        covariance = lanes_minor(scale * jnp.eye(size, dtype=scale.dtype))
        return FitState(lanes_minor(jnp.full((size,), zero)), covariance, zero, zero, zero, zero)

    def step(self, state: FitState, features: Vector, target: Scalar) -> tuple[FitState, Scalar]:
        """Use one sample; return (state, stability factor a).

        Features whose leverage is no number, negative, or overflows, change nothing; an innovation that overflows
        changes no coefficient. One that is no number makes them NaN: whatever feeds the fit has diverged, and P,
        which the torque has no say in, would go on to claim more and more.
        """
        column = symmetric_product(state.covariance, features)
        leverage = dot(features, column)
        # Powers of a reading that is absurd but finite overflow, in single precision sooner. NaN compares false.
        # The torque must have no say in what becomes of P, so an absurd one is kept out further below.
        # Nor is one used where rounding has left of a badly scaled P nothing positive: P would grow without bound.
        is_usable = once((leverage >= 0.0) & (leverage < _OVERFLOW))
        column = jnp.where(is_usable, column, 0.0)
        leverage = jnp.where(is_usable, leverage, 0.0)
        factor, inflation, spread = self.law(leverage)
        gain = once(factor / (1.0 + leverage))
        innovation = target - dot(features, state.coefficients)
        is_left_out = jnp.logical_not(is_usable) | (jnp.abs(innovation) >= _OVERFLOW_ROOT)
        innovation = once(jnp.where(is_left_out, 0.0, innovation))
        correction = once(gain * innovation)
        spread = self._with_prior(spread, lambda: dot(column, column))
        seen = self._with_prior(innovation, lambda: -dot(column, state.coefficients))
        normalised = once(seen * once(1.0 / jnp.sqrt(spread)))
        memory = self.law.memory()
        covariance = rank_one_downdate(state.covariance, column, gain)
        if inflation is not None:
            # The downdate is symmetric and leaves what rounding makes asymmetric; inflated at every sample, that
            # would outgrow P within some 37/(1 − λ) samples.
            covariance = scaled_symmetric_part(covariance, inflation)
        state = FitState(
            lanes_minor(state.coefficients + correction * column),
            covariance,
            memory * state.squares + normalised * normalised,
            memory * state.products + normalised * state.last,
            memory * state.weight + jnp.where(is_usable, 1.0, 0.0),
            normalised,
        )
        return state, factor

    def predict(self, state: FitState, direction: Vector) -> Scalar:
        """Return directionᵀη."""
        value = dot(direction, state.coefficients)
        return self._with_prior(
            value, lambda: dot(symmetric_product(state.covariance, direction), state.coefficients)
        )

    def variance(self, state: FitState, direction: Vector) -> Scalar:
        """Return the posterior variance of directionᵀη.

        Var = s² · f · directionᵀ P' direction, where s² is the innovations' variance and f = (1 + r)/(1 − r)
        accounts for their correlation r from one sample to the next: a filtered torque or hysteresis carries
        far fewer independent samples than the recording has. Infinite until there are more samples than
        coefficients, and where rounding has left of P nothing that is positive in this direction.
        """
        column = symmetric_product(state.covariance, direction)
        spread = self._with_prior(dot(direction, column), lambda: dot(column, column)) * self.law.posterior_scale()
        freedom = state.weight - len(direction)
        noise = state.squares / jnp.maximum(freedom, 1.0)
        total = jnp.maximum(state.squares, jnp.finfo(spread.dtype).tiny)
        correlation = jnp.clip(state.products / total, 0.0, 0.999)
        variance = noise * spread * (1.0 + correlation) / (1.0 - correlation)
        return jnp.where((freedom > 0.0) & ~(spread < 0.0), variance, jnp.inf)

    def determined(self, state: FitState) -> Scalar:
        """Return the effective degrees of freedom d − tr(P)/κ, the trace of the ridge regression's hat matrix.

        A coefficient counts 1 once the data fix it, and 0 while it is what the prior says. With forgetting the
        covariance of a direction that is no longer excited outgrows the prior; the count stops at 0.
        """
        undetermined = self._with_prior(trace(state.covariance), lambda: sum_of_squares(state.covariance))
        return jnp.maximum(state.covariance.shape[0] - undetermined / self.prior_scale, 0.0)

    def _with_prior(self, value: Scalar, slope: Callable[[], Scalar]) -> Scalar:
        """Return `value`, its derivative in κ being `slope` / κ² where the fit is ridge regression."""
        if not self.law.is_ridge:
            return value
        return with_slope(value, slope() / self.prior_scale**2, self.prior_scale)
