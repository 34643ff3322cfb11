"""What every controller is: `init` and `step` over what one joint does, pure and unbatched."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import equinox as eqx

from vsajax.types import Command, Swing


class AbstractController(eqx.Module):
    """A controller of one joint; an arm has one a joint, and each knows its own joint only.

    `step` must not call LAPACK, random numbers or the host: it is what runs on a robot.
    """

    @abstractmethod
    def init(self, swing: Swing) -> Any:
        """Return the state before the first instant, which `step` then processes as any other."""

    @abstractmethod
    def step(self, state: Any, swing: Swing) -> tuple[Any, Command]:
        """Process one instant; return (state, command)."""
