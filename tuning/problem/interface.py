"""What a kind of study gives the methods: its score as a pure function of numbers and scenarios.

Sweeps, populations, comparisons and searches know nothing else of what they run over.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple, Protocol, runtime_checkable

from jaxtyping import Array, Float, Key

from tuning.study.base import Study
from tuning.study.kinds import kind_of

if TYPE_CHECKING:
    from vsajax.rollout.sensitivity import Loop

Stream = Literal["train", "held_out", "population", "sensitivity"]
Values = Mapping[str, Float[Array, "..."]]
LANES = 256
"""`Problem.lanes` where outcomes are computed sample by sample; more are too many for the cache."""


class Scenario(NamedTuple):
    """What tells one scenario from another, or `(scenario,)` of them.

    Args:
        key: of all that has no number: the clock's jitter and the sensors' noise, or a pose.
        numbers: the population's numbers by path, and what else its kind tells scenarios apart by.
    """

    key: Key[Array, "..."]
    numbers: dict[str, Float[Array, "..."]]


class Status(enum.IntEnum):
    """How a scenario ended: only the scores of an `OK` one count."""

    OK = 0
    MOTION_DIVERGED = 1
    STEP_TOO_COARSE = 2
    ESTIMATE_DIVERGED = 3
    NO_DESIGN = 4

    @property
    def reason(self) -> str:
        """What happened, for people."""
        return _REASONS[self]


_REASONS = {
    Status.OK: "scored",
    Status.MOTION_DIVERGED: "the simulated motion is not finite",
    Status.STEP_TOO_COARSE: "the joint is too stiff for the study's integration steps: set `substeps`",
    Status.ESTIMATE_DIVERGED: "an estimate is not finite",
    Status.NO_DESIGN: "no design can be used",
}


class Outcome(NamedTuple):
    """A scenario's scores, and whether they count.

    Args:
        scores: a named tuple of numbers, see `study.scores`.
        status: a `Status`.
    """

    scores: Any
    status: Float[Array, "..."]


class Problem(Protocol):
    """A study made computable.

    It is made from the study and the dotted paths of the numbers that will vary beside the population's.
    """

    @property
    def study(self) -> Study:
        """The study."""
        ...

    lanes: ClassVar[int]
    """Outcomes computed at a time on a device; more fall out of the cache, or of memory."""

    @property
    def samples(self) -> int:
        """How much work a scenario is: as many samples of a joint's simulation. Chunks of a run are cut by it."""
        ...

    @property
    def given(self) -> Any:
        """What the functions below are given: as an argument, so that one compilation serves every value."""
        ...

    def scenarios(self, stream: Stream, count: int, start: int = 0) -> Scenario:
        """Return the scenarios `start`, `start` + 1, … of a stream: each is the same however many are drawn."""
        ...

    def outcome(self, values: Values, scenario: Scenario, given: Any) -> Outcome:
        """Return the scores at `values` in a scenario, and whether they count."""
        ...


class Recorded(Problem, Protocol):
    """A problem whose scenarios have signals over time."""

    if_not_finite: ClassVar[tuple[str, str]]
    """The table to look at where a simulation is not finite, and what to do."""

    @property
    def substeps(self) -> int:
        """Integration steps a sample."""
        ...

    def columns(self, scenario: Scenario, given: Any) -> dict[str, Array]:
        """Return the signals of a scenario by name, the truth among them, each `(time,)`."""
        ...


@runtime_checkable
class Differentiable(Problem, Protocol):
    """A problem whose objective has a gradient."""

    def observe(self, values: Values, scenario: Scenario, given: Any) -> Any:
        """Return all of a scenario that `values` which reach no further than the estimate leave as it is."""
        ...

    def residuals(self, values: Values, scenario: Scenario, given: Any, observed: Any) -> Loop:
        """Return the loop whose residuals' squares sum to the scenario's objective.

        Args:
            values: numbers by path.
            scenario: one scenario.
            given: what `given` has.
            observed: what `observe` returns, where `values` do not change it, or `None`.
        """
        ...


def problem_of(study: Study, varied: tuple[str, ...] = ()) -> Problem:
    """Return the problem that a study poses.

    Args:
        study: the study.
        varied: dotted paths of the numbers that will vary, beside the population's.
    """
    make = kind_of(study).problem
    assert make is not None, study.kind
    return make.load()(study, varied)
