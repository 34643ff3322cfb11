"""Studies of a controller that brings a link to rest."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from tuning.files.errors import Mistake
from tuning.study.base import Timed
from tuning.study.parts.base import AtLeastOne, Positive
from tuning.study.parts.swings import (
    Combined,
    Controller,
    FeedbackSensor,
    Impact,
    Plant,
    StiffnessSwitch,
    SwingObserver,
    SwingScorer,
)
from tuning.study.scores import Objective


class DampingStudy(Timed):
    """A study of a controller that brings a link to rest by its stiffness or its motor."""

    varied: ClassVar[tuple[str, ...]] = (
        *("scorer", "clock", "plant", "impact"),
        *("controller", "sensor", "observer", "start"),
    )
    contested: ClassVar[tuple[str, ...]] = ("controller", "observer")
    objectives: ClassVar[tuple[Objective, ...]] = ("log_energy", "settling_time")
    plant: Plant
    impact: Impact
    controller: Controller
    sensor: FeedbackSensor | None = None
    observer: SwingObserver = SwingObserver()
    scorer: SwingScorer = SwingScorer()
    start: Positive | None = None
    substeps: AtLeastOne = 1

    def has_own_motions(self) -> bool:
        """Return that every scenario moves in its own way: a controller answers its own sensor."""
        return True

    def substeps_set(self) -> int:
        """Return the integration steps a sample."""
        return self.substeps

    def longest_delay(self) -> int:
        """Return how many samples a reading may be late."""
        return 0 if self.sensor is None or self.sensor.delay is None else self.sensor.longest_delay

    def mistakes(self, place: str) -> Iterator[Mistake]:
        """Return what is wrong of the clock: a controller's is regular."""
        if self.clock.jitter_std is not None:
            fix = "remove it: a controller's clock is regular"
            yield Mistake(f"{place}: clock.jitter_std", f"got {self.clock.jitter_std}", fix)

    def no_gradient(self, place: str, method: str) -> Mistake | None:
        """Return which part of the score is a staircase or jumps; `None` where none does."""
        fix = "use --method grid, tpe or cmaes"
        if self.tune.objective != "log_energy":
            problem = f"got {self.tune.objective!r}, a staircase, for --method {method}"
            return Mistake(f"{place}: tune.objective", problem, f'set it to "log_energy", or {fix}')
        own = self.controller
        path, chosen = ("controller", own)
        if isinstance(own, Combined):
            path, chosen = ("controller.stiffness", own.stiffness)
        if isinstance(chosen, StiffnessSwitch):
            problem = f"got 'switch', whose score jumps, for --method {method}"
            return Mistake(f"{place}: {path}.type", problem, f'set it to "smooth", or {fix}')
        return None
