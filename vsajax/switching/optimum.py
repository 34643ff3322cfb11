"""The least energy at a given time, by the minimum principle: sections III–IV of Gasparri et al., corrected.

One link without friction, ẋ₁ = x₂, ẋ₂ = −w² x₁ with w² = k/I. An extremal has k_max where λ₂x₁ > 0 and k_min where
it is negative, (6). Backwards from its end it is determined by the end alone: costates are the cost's gradient
there, and each interval is as long as the smaller of (9) and (10). All is homogeneous, so that an extremal is the
direction of its end and a size; that it starts in the direction of the given start is one equation.

Corrections: (11) and (12) equal (9) and (10) modulo π/w only, and the rule (13)–(14) that chooses between them
must be the smaller positive one; (16) and (18) change frequency with the interval they describe, which is done
here by stepping back interval by interval. The paper's φ = ½x₁² + ½x₂² adds rad² and rad²/s²: what is optimal
depends on the unit of time, and in SI it is nearly the kinetic energy alone. Say which cost you mean.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from vsajax import rollout
from vsajax.switching.oscillator import Oscillator, Phase

Value = Float[Array, "..."]
_BISECTIONS = 40
_JUST_NOW = 1e-9


class EndCost(NamedTuple):
    """½ (position x₁² + velocity x₂²) at the end.

    Args:
        position: 1/s² for energies, which are per inertia; 1 for the paper's φ.
        velocity: 1.
    """

    position: Value
    velocity: Value

    @classmethod
    def printed(cls) -> EndCost:
        """Return φ of the paper, whose unit depends on that of time."""
        return cls(jnp.ones(()), jnp.ones(()))

    @classmethod
    def energy(cls, stiffness: Value, inertia: Value) -> EndCost:
        """Return the energy per inertia with the spring at a stiffness [rad²/s²]."""
        return cls(stiffness / inertia, jnp.ones_like(inertia))

    def of(self, phase: Phase) -> Value:
        """Return the cost of an end."""
        return 0.5 * (self.position * phase.position**2 + self.velocity * phase.velocity**2)


class Extremal(NamedTuple):
    """An extremal from its start to its end.

    Args:
        start: its first instant.
        end: its last.
        durations: of its intervals, the last of them first; 0 beyond the start [s].
        is_stiff: on each of them.
    """

    start: Phase
    end: Phase
    durations: Float[Array, "... interval"]
    is_stiff: Bool[Array, "... interval"]


class Optimum(NamedTuple):
    """The best extremal.

    Args:
        cost: at its end.
        extremal: itself.
    """

    cost: Value
    extremal: Extremal


def time_since_centre(phase: Phase, rate: Value) -> Value:
    """Return how long ago the position was 0 at a constant w, in (0, π/w]: (9) [s]."""
    return _since(-phase.velocity, phase.position * rate) / rate


def time_since_turn(costate: Phase, rate: Value) -> Value:
    """Return how long ago λ₂ was 0 at a constant w, in (0, π/w]: (10) [s]; `costate` holds λ₁ and λ₂."""
    return _since(costate.position, costate.velocity * rate) / rate


def _since(a: Value, b: Value) -> Value:
    """Return 2 arctan(a/b + √(1 + (a/b)²)), which is the angle in (0, π] with cotangent −a/b."""
    angle = jnp.mod(jnp.arctan2(b, -a), jnp.pi)
    # An event that has just happened is half a turn ago, whatever rounding says.
    return jnp.where(angle < _JUST_NOW, angle + jnp.pi, angle)


def extremal_to(end: Phase, time: Value, cost: EndCost, soft: Value, stiff: Value, *, intervals: int) -> Extremal:
    """Return the extremal of a given length that ends at `end`.

    Args:
        end: x(T).
        time: T [s].
        cost: whose gradient there are the costates.
        soft: √(k_min/I) [rad/s].
        stiff: √(k_max/I) [rad/s].
        intervals: how many are stepped back at most.
    """
    costate = Phase(cost.position * end.position, cost.velocity * end.velocity)
    # Stiff where λ₂x₁ > 0; where it is 0 at the end, that is at a switch, where it grows smaller in magnitude.
    product = costate.velocity * end.position
    just_before = costate.position * end.position - costate.velocity * end.velocity
    starts_stiff = jnp.where(product == 0.0, just_before, product) > 0.0

    def back(carry: tuple[Phase, Phase, Value, Bool[Array, ""]], _: Value) -> tuple[Any, Any]:
        phase, costate, left, is_stiff = carry
        rate = jnp.where(is_stiff, stiff, soft)
        length = jnp.minimum(time_since_centre(phase, rate), time_since_turn(costate, rate))
        length = jnp.minimum(length, left)
        cos, sin = jnp.cos(rate * length), jnp.sin(rate * length)
        x, v = phase
        first, second = costate
        before = Phase(x * cos - v / rate * sin, v * cos + x * rate * sin)
        costate = Phase(first * cos - second * rate * sin, second * cos + first / rate * sin)
        return (before, costate, left - length, ~is_stiff), (length, is_stiff)

    carry, (durations, is_stiff) = rollout.scan(back, (end, costate, time, starts_stiff), jnp.zeros(intervals))
    return Extremal(carry[0], end, durations, is_stiff)


def optimum(
    start: Phase,
    time: Value,
    cost: EndCost,
    soft: Value,
    stiff: Value,
    *,
    directions: int = 2048,
    intervals: int = 16,
) -> Optimum:
    """Return the extremal from `start` with the least cost after `time` [s].

    Every direction of the end is tried, all brackets of one that starts in the right direction are bisected, and
    the cheapest is taken: a necessary condition, searched globally.

    Args:
        start: x(0).
        time: T [s].
        cost: what is least.
        soft: √(k_min/I) [rad/s].
        stiff: √(k_max/I) [rad/s].
        directions: of the end, over half a turn.
        intervals: most intervals of an extremal.
    """
    scale = jnp.sqrt(soft * stiff)

    def shoot(angle: Value) -> Extremal:
        end = Phase(jnp.cos(angle), scale * jnp.sin(angle))
        return extremal_to(end, time, cost, soft, stiff, intervals=intervals)

    def miss(angle: Value) -> Value:
        found = shoot(angle).start
        return found.position * start.velocity - found.velocity * start.position

    angles = jnp.linspace(0.0, jnp.pi, directions + 1) + 1e-9
    misses = jax.vmap(miss)(angles)
    below = misses[:-1]
    brackets = below * misses[1:] <= 0.0

    def halve(ends: tuple[Value, Value], _: Value) -> tuple[tuple[Value, Value], None]:
        low, high = ends
        middle = 0.5 * (low + high)
        is_low = jax.vmap(miss)(middle) * below > 0.0
        return (jnp.where(is_low, middle, low), jnp.where(is_low, high, middle)), None

    low, high = rollout.scan(halve, (angles[:-1], angles[1:]), jnp.zeros(_BISECTIONS))[0]
    # An end on a switch is one of a jump, which no bracket finds: both are tried as they are.
    ones, none = jnp.ones(1), jnp.zeros(1)
    ends = Phase(jnp.concatenate([ones, none]), scale * jnp.concatenate([none, ones]))
    on_switches = jax.vmap(lambda end: extremal_to(end, time, cost, soft, stiff, intervals=intervals))(ends)
    between = jax.vmap(shoot)(0.5 * (low + high))
    shot = jax.tree.map(lambda a, b: jnp.concatenate([a, b]), between, on_switches)
    brackets = jnp.concatenate([brackets, jnp.ones(2, bool)])
    along = scale**2 * shot.start.position * start.position + shot.start.velocity * start.velocity
    size = along / (scale**2 * shot.start.position**2 + shot.start.velocity**2)
    # Where the miss jumps instead of crossing 0, the start is not hit.
    off = jnp.hypot(
        scale * (size * shot.start.position - start.position), size * shot.start.velocity - start.velocity
    )
    reached = off < 1e-6 * jnp.hypot(scale * start.position, start.velocity)
    costs = jnp.where(brackets & reached, size**2 * cost.of(shot.end), jnp.inf)
    best = jnp.argmin(costs)
    chosen = jax.tree.map(lambda x: x[best], shot)
    sized = [Phase(size[best] * p.position, size[best] * p.velocity) for p in (chosen.start, chosen.end)]
    return Optimum(costs[best], chosen._replace(start=sized[0], end=sized[1]))


def switched_end(
    start: Phase, switches: Float[Array, " switch"], time: Value, soft: Value, stiff: Value, *, first_stiff: bool
) -> Phase:
    """Return the end of a motion that changes stiffness at given times: what a search over them minimises.

    Args:
        start: x(0).
        switches: increasing times in [0, T] [s].
        time: T [s].
        soft: √(k_min/I) [rad/s].
        stiff: √(k_max/I) [rad/s].
        first_stiff: whether it is stiff before the first of them.
    """
    free = Oscillator(jnp.ones(()), jnp.zeros(()))
    phase, now = start, jnp.zeros(())
    for i, end in enumerate([*switches, time]):
        rate = stiff if (i % 2 == 0) == first_stiff else soft
        phase = free.flow(phase, rate**2, end - now)
        now = end
    return phase
