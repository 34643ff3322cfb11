"""When an estimate deserves to be believed."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool

from vsajax.types import Scalar, as_leaf


class GateState(NamedTuple):
    """The smallest and largest deflection so far [rad]."""

    lowest: Scalar
    highest: Scalar


class ExcitationGate(eqx.Module):
    """Calls a stiffness known once the deflection has moved, the posterior is tight, and the stiffness is one.

    All are needed: while nothing moves, sensor noise alone can shrink a covariance; a single large movement says
    nothing about a characteristic with many coefficients; and no spring has a stiffness of 0 or below.

    Args:
        min_deflection_range: largest minus smallest deflection so far must exceed this [rad].
        max_relative_std: the posterior standard deviation must be below this share of the stiffness.
    """

    min_deflection_range: Scalar = eqx.field(converter=as_leaf, default=0.0)
    max_relative_std: Scalar = eqx.field(converter=as_leaf, default=0.1)

    def init(self, deflection: Scalar) -> GateState:
        """Return the state before the first sample is processed."""
        return GateState(deflection, deflection)

    def step(
        self, state: GateState, deflection: Scalar, stiffness: Scalar, std: Scalar
    ) -> tuple[GateState, Bool[Array, ""]]:
        """Return (state, whether the stiffness is known)."""
        state = GateState(jnp.minimum(state.lowest, deflection), jnp.maximum(state.highest, deflection))
        has_moved = state.highest - state.lowest > self.min_deflection_range
        # The right side is no number, infinite or not positive where the stiffness is; a comparison is then false,
        # but for a finite band around an infinite stiffness.
        is_tight = (std < self.max_relative_std * stiffness) & (stiffness < jnp.inf)
        return state, has_moved & is_tight
