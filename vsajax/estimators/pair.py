"""Two transmissions that pull against each other, each with an estimator of its own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp

from vsajax.estimators.base import AbstractEstimator, Prepared
from vsajax.types import Estimate, Sample

_POSITION, _TORQUE = "motor_position", "motor_torque"


class PairState(NamedTuple):
    """The states of the two sides."""

    first: Any
    second: Any


class AntagonisticPair(AbstractEstimator):
    """The stiffness of an agonist-antagonist joint: the sum of its two transmissions' stiffnesses.

    The estimators work on the motor sides, so each needs only its own motor and the link.

    Args:
        side: the estimator of the first transmission, and of the second unless `other` is given.
        other: the estimator of the second transmission where the motors differ.
    """

    side: AbstractEstimator
    other: AbstractEstimator | None = None

    @property
    def both(self) -> tuple[AbstractEstimator, AbstractEstimator]:
        """The estimators of the two sides."""
        return self.side, self.side if self.other is None else self.other

    @property
    def needs(self) -> frozenset[str]:
        """Names of the signals that a recording must have."""
        names = set()
        for number, estimator in enumerate(self.both, 1):
            for name in estimator.needs:
                names.add(name.replace("motor_", f"motor{number}_") if name in (_POSITION, _TORQUE) else name)
        return frozenset(names)

    def init(self, sample: Sample) -> PairState:
        """Return both states before the first sample."""
        first, second = self.both
        return PairState(first.init(sample.side(1)), second.init(sample.side(2)))

    def step(self, state: PairState, sample: Sample) -> tuple[PairState, Estimate]:
        """Process one sample on both sides; return (states, sum)."""
        stepped = [e.step(s, sample.side(n)) for n, (e, s) in enumerate(zip(self.both, state, strict=True), 1)]
        return PairState(stepped[0][0], stepped[1][0]), _sum(stepped[0][1], stepped[1][1])

    def offline(self, samples: Sample) -> Prepared:
        """Return both sides over a whole recording."""
        first, second = (e.offline(samples.side(n)) for n, e in enumerate(self.both, 1))
        step = BothSteps(first.step, second.step)
        return Prepared(PairState(first.state, second.state), (first.inputs, second.inputs), step)


class BothSteps(eqx.Module):
    """The steps of two prepared recordings as one.

    Args:
        first: of side 1.
        second: of side 2.
    """

    first: Callable[[Any, Any], tuple[Any, Estimate]]
    second: Callable[[Any, Any], tuple[Any, Estimate]]

    def __call__(self, state: PairState, inputs: tuple[Any, Any]) -> tuple[PairState, Estimate]:
        """Process one sample on both sides; return (states, sum)."""
        left, one = self.first(state.first, inputs[0])
        right, two = self.second(state.second, inputs[1])
        return PairState(left, right), _sum(one, two)


def _sum(first: Estimate, second: Estimate) -> Estimate:
    return Estimate(
        stiffness=first.stiffness + second.stiffness,
        # The sides share the link encoder, but torque noise, which dominates, is their own.
        stiffness_std=jnp.hypot(first.stiffness_std, second.stiffness_std),
        elastic_torque=first.elastic_torque + second.elastic_torque,
        known=first.known & second.known,
        signals=first.signals._replace(determined=first.signals.determined + second.signals.determined),
        sides=(first, second),
    )
