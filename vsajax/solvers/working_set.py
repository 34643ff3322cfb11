"""Which bounds to hold next."""

from __future__ import annotations

from typing import Literal

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from vsajax.solvers.box import OUTSIDE, WRONG_SIGN, Scaled

Values = Float[Array, "n ..."]
Rule = Literal["add_first", "drop_first"]


def corrected(problem: Scaled, x: Values, working: Values, rule: Rule = "add_first") -> Values:
    """Return the working set after x, the solution on the present one; it is the same at the optimum.

    Args:
        problem: the scaled problem.
        x: solution with `working` held.
        working: −1, 0 or +1 a number.
        rule: "add_first" adds all that lie outside and, only if none does, lets go the one with the worst
            multiplier: no cycle is known. "drop_first" is the paper's text: lets go all with a negative multiplier
            and, only if there is none, adds all outside; it may cycle.
    """
    outside = jnp.where(x < problem.lower - OUTSIDE, -1.0, jnp.where(x > 1.0 + OUTSIDE, 1.0, 0.0))
    added = working + jnp.where(working == 0.0, outside, 0.0)
    # Held at the lower bound the gradient must not be negative, at the upper not positive.
    pull = working * problem.gradient(x)
    if rule == "drop_first":
        wrong = pull > WRONG_SIGN
        return jnp.where(wrong.any(0), jnp.where(wrong, 0.0, working), added)
    worst = pull.max(0)
    dropped = jnp.where((pull >= worst) & (worst > WRONG_SIGN), 0.0, working)
    return jnp.where(_any_outside(working, outside), added, dropped)


def _any_outside(working: Values, outside: Values) -> Bool[Array, "..."]:
    return ((working == 0.0) & (outside != 0.0)).any(0)
