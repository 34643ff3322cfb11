"""What every estimator is: `init` and `step` over samples, pure and unbatched."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax

from vsajax.types import Estimate, Sample


class Prepared(NamedTuple):
    """A whole recording made ready for a scan.

    Args:
        state: before the first sample.
        inputs: with a leading time axis.
        step: (state, input) -> (state, estimate); a module or a method of one, so that its leaves are seen.
    """

    state: Any
    inputs: Any
    step: Callable[[Any, Any], tuple[Any, Estimate]]


class AbstractEstimator(eqx.Module):
    """An online estimator of joint stiffness.

    `step` is the online filter and what is exported. It must not call LAPACK, random numbers or the host.
    """

    @property
    @abstractmethod
    def needs(self) -> frozenset[str]:
        """Names of the signals that a recording must have."""

    @abstractmethod
    def init(self, sample: Sample) -> Any:
        """Return the state before the first sample, which `step` then processes as any other."""

    @abstractmethod
    def step(self, state: Any, sample: Sample) -> tuple[Any, Estimate]:
        """Process one sample; return (state, estimate)."""

    def offline(self, samples: Sample) -> Prepared:
        """Return the same filter over a whole recording, with what needs no recursion already done.

        The estimates are those of `step`; an estimator whose step looks at many samples prepares them faster.

        Args:
            samples: leaves with a leading time axis.
        """
        return Prepared(self.init(jax.tree.map(lambda x: x[0], samples)), samples, self.step)
