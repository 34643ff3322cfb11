"""What every estimator is: `init` and `step` over samples, pure and unbatched."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import equinox as eqx

from vsajax.types import Estimate, Sample


class AbstractEstimator(eqx.Module):
    """An online estimator of joint stiffness.

    The same `step` is the offline scan, the online filter and what is exported. It must not call LAPACK,
    random numbers or the host.
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
