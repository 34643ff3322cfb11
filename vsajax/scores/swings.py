"""How well a joint comes to rest: scores accumulated sample by sample, in constant memory."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from vsajax import showing
from vsajax.types import Scalar, as_leaf


class SwingScores(NamedTuple):
    """The scores of one closed loop.

    Args:
        settling_time: all joints stay within the band from here on, the last exit [s]; infinite where that is in
            the last fifth of the run, too late to tell rest from a limit cycle.
        log_energy: mean over time of ln(1 + E/E_b), with E_b the energy at the band: of a decay E₀ e^(−λt) it is
            ln²(E₀/E_b) / 2λT. It rises with settling time as that does on average, but without its steps.
        decay_rate: of the amplitude: the slope of −½ ln E, by least squares while E ≥ E_b [1/s].
        residual: largest |q| over the last fifth [rad]: 0 at rest, the amplitude of a limit cycle.
        peak: largest |q| [rad].
        switches: commands that crossed the middle of the range, a second [1/s].
        travel: way of the stiffness, in ranges a second [1/s].
        diverged: 1 if a position was not finite, else 0.
    """

    settling_time: Float[Array, "..."]
    log_energy: Float[Array, "..."]
    decay_rate: Float[Array, "..."]
    residual: Float[Array, "..."]
    peak: Float[Array, "..."]
    switches: Float[Array, "..."]
    travel: Float[Array, "..."]
    diverged: Float[Array, "..."]

    @property
    def convergence_time(self) -> Float[Array, "..."]:
        """Return the settling time: what other scores call it."""
        return self.settling_time

    _repr_html_ = showing.to_html
    to_pandas = showing.to_pandas


class Swept(NamedTuple):
    """What a `SwingScorer` looks at, at one instant.

    Args:
        time: [s].
        excursion: largest |q| of the joints [rad].
        energy: with every spring in the middle of its range [J].
        commanded: commanded stiffness, −1 soft … 1 stiff, of each joint.
        stiffness: the same of the true one.
    """

    time: Scalar
    excursion: Scalar
    energy: Scalar
    commanded: tuple[Scalar, ...]
    stiffness: tuple[Scalar, ...]


class SwingScoreState(NamedTuple):
    """Running sums and marks of a `SwingScorer`."""

    last: Swept
    last_exit: Scalar
    log_energy: Scalar
    samples: Scalar
    counted: Scalar
    times: Scalar
    squared_times: Scalar
    logs: Scalar
    products: Scalar
    residual: Scalar
    peak: Scalar
    switches: Scalar
    travel: Scalar
    diverged: Scalar


class SwingScorer(eqx.Module):
    """Judges how a joint comes to rest.

    Args:
        band: |q| within which a joint has settled [rad].
    """

    band: Scalar = eqx.field(converter=as_leaf, default=0.05)

    def init(self, first: Swept) -> SwingScoreState:
        """Return the state before the first sample, which `step` then counts as any other."""
        zero = jnp.zeros_like(first.time)
        return SwingScoreState(last=first, **dict.fromkeys(SwingScoreState._fields[1:], zero))

    def step(
        self, state: SwingScoreState, swept: Swept, *, band_energy: Scalar, duration: float
    ) -> SwingScoreState:
        """Count one sample.

        Args:
            state: so far.
            swept: the sample.
            band_energy: E_b [J].
            duration: of the whole run, for what its end is [s].
        """
        last, excursion = state.last, swept.excursion
        is_outside = ~(excursion <= self.band)
        # The exit lies between samples: where the excursion, taken as linear, crosses the band.
        share = (last.excursion - self.band) / jnp.where(is_outside, 1.0, last.excursion - excursion)
        crossed = last.time + (swept.time - last.time) * share
        has_entered = (last.excursion > self.band) & ~is_outside
        relative = swept.energy / band_energy
        counts = jnp.where(relative >= 1.0, 1.0, 0.0)
        log = jnp.log(jnp.where(relative >= 1.0, relative, 1.0))
        sides = zip(swept.commanded, last.commanded, strict=True)
        ways = zip(swept.stiffness, last.stiffness, strict=True)
        zero = jnp.zeros_like(log)
        return SwingScoreState(
            last=swept,
            last_exit=jnp.where(is_outside, swept.time, jnp.where(has_entered, crossed, state.last_exit)),
            log_energy=state.log_energy + jnp.log1p(relative),
            samples=state.samples + 1.0,
            counted=state.counted + counts,
            times=state.times + counts * swept.time,
            squared_times=state.squared_times + counts * swept.time**2,
            logs=state.logs + counts * log,
            products=state.products + counts * log * swept.time,
            residual=jnp.where(swept.time >= 0.8 * duration, jnp.maximum(state.residual, excursion), zero),
            peak=jnp.maximum(state.peak, excursion),
            switches=state.switches + sum((jnp.where(a * b < 0.0, 1.0, 0.0) for a, b in sides), zero),
            travel=state.travel + sum((0.5 * jnp.abs(a - b) for a, b in ways), zero),
            diverged=jnp.maximum(state.diverged, jnp.where(jnp.isfinite(excursion), 0.0, 1.0)),
        )

    def scores(self, state: SwingScoreState, *, duration: float) -> SwingScores:
        """Return the scores of the samples counted so far."""
        count = state.counted
        spread = count * state.squared_times - state.times**2
        slope = (count * state.products - state.times * state.logs) / jnp.where(spread > 0.0, spread, 1.0)
        is_settled = (state.residual <= self.band) & (state.last_exit < 0.8 * duration)
        return SwingScores(
            settling_time=jnp.where(is_settled, state.last_exit, jnp.inf),
            log_energy=state.log_energy / state.samples,
            decay_rate=jnp.where(spread > 0.0, -0.5 * slope, jnp.nan),
            residual=state.residual,
            peak=state.peak,
            switches=state.switches / duration,
            travel=state.travel / duration,
            diverged=state.diverged,
        )
