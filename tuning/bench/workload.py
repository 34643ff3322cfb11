"""What a kernel is: a JAX program, its inputs, and who else computes the same."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tuning.bench.opponent import Opponent

AGREEMENT = 1e-9
"""Largest relative difference to C at which times count."""


@dataclass(frozen=True)
class Workload:
    """A kernel with its inputs.

    Args:
        program: the jitted program.
        arguments: of the program.
        lanes: how many joints, recordings or configurations.
        samples: of each lane.
        flops: floating-point operations a lane-step of the algorithm that ours runs, or `None`.
        twin: runs the same in C and returns what the program returns, or `None`.
        base: a program of ours, of the same arguments, that the ratio is taken to instead of C, or `None`.
        arrange: brings what the program returns into the shape of the twin's result.
    """

    program: Any
    arguments: tuple[Any, ...]
    lanes: int
    samples: int
    flops: float | None = None
    twin: Callable[[Opponent], np.ndarray] | None = None
    base: Any = None
    arrange: Callable[[Any], np.ndarray] = np.asarray

    @property
    def steps(self) -> int:
        """Return lanes times samples."""
        return self.lanes * self.samples

    def difference(self, ours: Any, theirs: np.ndarray) -> float:
        """Return the largest relative difference of both results; infinite where one is not finite."""
        mine = self.arrange(ours)
        if mine.shape != theirs.shape or not (np.all(np.isfinite(mine)) and np.all(np.isfinite(theirs))):
            return float("inf")
        return float(np.max(np.abs(mine - theirs) / np.maximum(np.abs(theirs), np.finfo(float).tiny)))


@dataclass(frozen=True)
class Kernel:
    """A row of the bench.

    Args:
        name: for `--only`, the JSON and the record.
        title: for people.
        lanes: of the bench's run.
        prepare: (lanes, settings of the study) -> workload.
        limit: largest ratio to C, or to the base; `None` where there is none.
        counting: how `flops` were counted.
        ns_limit: most that a lane and sample may take, on two cores [ns]; `None` where there is no such limit.
    """

    name: str
    title: str
    lanes: int
    prepare: Callable[[int, Sequence[str]], Workload]
    limit: float | None
    counting: str
    ns_limit: float | None = None
