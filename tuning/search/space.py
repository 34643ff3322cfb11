"""Bounded physical numbers <-> an unbounded vector for optimisers."""

from __future__ import annotations

import math
from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float

from tuning.study.ranges import Bounds

Vector = Float[Array, " n"]


class Space(eqx.Module):
    """Numbers at dotted paths, each between bounds on a linear or logarithmic scale.

    A share u in (0, 1) of the way from the lower to the upper bound is u = 1/(1 + e^(−z)); the optimiser moves z.

    Args:
        paths: the numbers' dotted paths.
        low: lower bounds, on the scale.
        high: upper bounds, on the scale.
        is_log: which numbers are on a logarithmic scale.
    """

    low: Vector
    high: Vector
    paths: tuple[str, ...] = eqx.field(static=True)
    is_log: tuple[bool, ...] = eqx.field(static=True)

    @classmethod
    def of(cls, bounds: Mapping[str, Bounds]) -> Space:
        """Return the space of some bounds by path."""
        is_log = tuple(b.scale == "log" for b in bounds.values())
        ends = [jnp.asarray(b.ends(), float) for b in bounds.values()]
        scaled = jnp.stack([jnp.log(e) if log else e for e, log in zip(ends, is_log, strict=True)])
        return cls(scaled[:, 0], scaled[:, 1], tuple(bounds), is_log)

    @property
    def size(self) -> int:
        """Number of dimensions."""
        return len(self.paths)

    def sobol_shares(self, count: int, seed: int) -> np.ndarray:
        """Return `(count, n)` scrambled Sobol points in [0, 1), drawn from the next power of two."""
        sampler = scipy.stats.qmc.Sobol(self.size, rng=np.random.default_rng(seed))
        return sampler.random_base2(math.ceil(math.log2(count)))[:count]

    def at_share(self, share: Vector) -> dict[str, Float[Array, ""]]:
        """Return the numbers at shares of the way between the bounds."""
        place = self.low + (self.high - self.low) * share
        return {path: jnp.exp(place[i]) if self.is_log[i] else place[i] for i, path in enumerate(self.paths)}

    def share_of(self, values: Mapping[str, Float[Array, ""]]) -> Vector:
        """Return the shares of numbers."""
        place = jnp.stack(
            [
                jnp.log(values[p]) if log else jnp.asarray(values[p])
                for p, log in zip(self.paths, self.is_log, strict=True)
            ]
        )
        return (place - self.low) / (self.high - self.low)

    def constrain(self, z: Vector) -> dict[str, Float[Array, ""]]:
        """Return the numbers at an unbounded vector."""
        return self.at_share(jax.nn.sigmoid(z))

    def unconstrain(self, values: Mapping[str, Float[Array, ""]]) -> Vector:
        """Return the unbounded vector of numbers; one at or beyond a bound is put just inside it."""
        share = jnp.clip(self.share_of(values), 1e-3, 1.0 - 1e-3)
        return jnp.log(share) - jnp.log1p(-share)
