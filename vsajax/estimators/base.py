"""What every estimator is: `init` and `step` over samples, pure and unbatched."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import equinox as eqx

from vsajax.types import Estimate, Sample


class MissingSignalError(ValueError):
    """A recording lacks a signal that the estimator needs."""

    @classmethod
    def check(cls, needs: frozenset[str], sample: Sample) -> None:
        """Raise unless `sample` has every signal of `needs`."""
        present = {name for name, value in sample._asdict().items() if value is not None}
        missing = sorted(needs - present)
        if missing:
            raise cls(
                f"the estimator needs the signals {', '.join(missing)}, which the recording lacks; "
                f"it has {', '.join(sorted(present - {'dt'}))}. Record them, or choose another torque source, "
                "deflection or basis."
            )


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
