"""How good an estimate is: scores accumulated sample by sample, in constant memory.

MSE and MSREP are (35) and (36) of Flacco et al., IROS 2011, as printed: sums over samples 0 … p divided by p.
"""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from vsajax import showing
from vsajax.numerics import once, safe_divide
from vsajax.types import Estimate, Scalar, as_leaf


class Scores(NamedTuple):
    """The scores of one recording.

    Args:
        mse: mean squared error [(N·m/rad)²].
        msrep: mean squared relative error [%].
        mse_settled: the same from the warm-up time on.
        msrep_settled: the same from the warm-up time on [%].
        convergence_time: the relative error stays within the tolerance from here on [s]; infinite if never.
        max_relative_error: largest relative error from the warm-up time on.
        coverage: share of known samples whose true stiffness lies within `sigmas` standard deviations.
        known_time: the answer is first known here [s]; infinite if never.
        known_share: share of samples at which the answer is known.
        near_zero_share: share of samples whose true stiffness is too near zero for a relative error; they are
            left out of every relative score.
        diverged: 1 if any estimate was not finite, else 0.
    """

    mse: Float[Array, "..."]
    msrep: Float[Array, "..."]
    mse_settled: Float[Array, "..."]
    msrep_settled: Float[Array, "..."]
    convergence_time: Float[Array, "..."]
    max_relative_error: Float[Array, "..."]
    coverage: Float[Array, "..."]
    known_time: Float[Array, "..."]
    known_share: Float[Array, "..."]
    near_zero_share: Float[Array, "..."]
    diverged: Float[Array, "..."]

    _repr_html_ = showing.to_html
    to_pandas = showing.to_pandas


class ScoreState(NamedTuple):
    """Running sums and marks of a `Scorer`."""

    squares: Scalar
    relative_squares: Scalar
    settled_squares: Scalar
    settled_relative_squares: Scalar
    last_outside: Scalar
    last_time: Scalar
    largest: Scalar
    covered: Scalar
    known_time: Scalar
    known: Scalar
    near_zero: Scalar
    settled_near_zero: Scalar
    samples: Scalar
    settled: Scalar
    diverged: Scalar


class Scorer(eqx.Module):
    """Compares estimates with the true stiffness.

    Args:
        warm_up: settled scores count from this time [s].
        tolerance: relative error within which an estimate has converged.
        sigmas: half-width of the coverage interval in standard deviations.
        stiffness_floor: samples with |σ| at or below it have no relative error [N·m/rad].
    """

    warm_up: Scalar = eqx.field(converter=as_leaf, default=2.0)
    tolerance: Scalar = eqx.field(converter=as_leaf, default=0.05)
    sigmas: Scalar = eqx.field(converter=as_leaf, default=1.959963984540054)
    stiffness_floor: Scalar = eqx.field(converter=as_leaf, default=0.0)

    def init(self) -> ScoreState:
        """Return the state before the first sample."""
        zero = jnp.zeros_like(self.warm_up)
        never = jnp.full_like(zero, jnp.inf)
        return ScoreState(**dict.fromkeys(ScoreState._fields, zero))._replace(
            last_outside=-never, known_time=never, last_time=-never
        )

    def relative_error(self, stiffness: Float[Array, "..."], estimate: Float[Array, "..."]) -> Float[Array, "..."]:
        """Return (σ − σ̂)/σ, and 0 where |σ| does not exceed the floor."""
        is_near_zero = jnp.abs(stiffness) <= self.stiffness_floor
        return safe_divide(stiffness - estimate, jnp.where(is_near_zero, 0.0, stiffness))

    def step(self, state: ScoreState, time: Scalar, stiffness: Scalar, estimate: Estimate) -> ScoreState:
        """Count one sample with its true stiffness."""
        error, relative = once(
            (stiffness - estimate.stiffness, self.relative_error(stiffness, estimate.stiffness))
        )
        one = jnp.ones_like(error)
        near_zero = (jnp.abs(stiffness) <= self.stiffness_floor) * one
        settled = (time >= self.warm_up) * one
        known = estimate.known * one
        is_outside = ~(jnp.abs(relative) <= self.tolerance)
        return ScoreState(
            squares=state.squares + error * error,
            relative_squares=state.relative_squares + relative * relative,
            settled_squares=state.settled_squares + settled * error * error,
            settled_relative_squares=state.settled_relative_squares + settled * relative * relative,
            last_outside=jnp.where(is_outside, time, state.last_outside),
            last_time=time,
            largest=jnp.maximum(state.largest, settled * jnp.abs(relative)),
            covered=state.covered + known * (jnp.abs(error) <= self.sigmas * estimate.stiffness_std),
            known_time=jnp.where(estimate.known, jnp.minimum(state.known_time, time), state.known_time),
            known=state.known + known,
            near_zero=state.near_zero + near_zero,
            settled_near_zero=state.settled_near_zero + settled * near_zero,
            samples=state.samples + one,
            settled=state.settled + settled,
            diverged=jnp.maximum(state.diverged, ~jnp.isfinite(estimate.stiffness) * one),
        )

    def scores(self, state: ScoreState) -> Scores:
        """Return the scores of the samples counted so far; a mean over no samples is NaN."""

        def mean(total: Scalar, count: Scalar) -> Scalar:
            return jnp.where(count > 0.0, total / jnp.where(count > 0.0, count, 1.0), jnp.nan)

        # Sums of p + 1 terms over p, as printed; 1e-4 of the value at 10,000 samples.
        relative = 100.0 * mean(state.relative_squares, state.samples - state.near_zero - 1.0)
        settled_relative = 100.0 * mean(
            state.settled_relative_squares, state.settled - state.settled_near_zero - 1.0
        )
        return Scores(
            mse=mean(state.squares, state.samples - 1.0),
            msrep=relative,
            mse_settled=mean(state.settled_squares, state.settled - 1.0),
            msrep_settled=settled_relative,
            convergence_time=jnp.where(
                state.last_outside < state.last_time, jnp.maximum(state.last_outside, 0.0), jnp.inf
            ),
            max_relative_error=jnp.where(state.settled > 0.0, state.largest, jnp.nan),
            coverage=mean(state.covered, state.known),
            known_time=state.known_time,
            known_share=mean(state.known, state.samples),
            near_zero_share=mean(state.near_zero, state.samples),
            diverged=state.diverged,
        )
