"""What a score is: the one list of their names, units and directions, which every reader of scores goes by."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import PlainSerializer, ValidationError, ValidatorFunctionWrapHandler, WrapValidator

from tuning.study.plugins import Origin, Refused, installed
from tuning.study.registry import Registry


class Score(NamedTuple):
    """One number that a scenario ends with.

    Args:
        name: its column in results, and its field in what a problem's outcome holds.
        label: its name in tables and pictures.
        unit: empty where it has none.
        better: whether a low or a high one is better.
        is_objective: whether a search can minimise it.
        is_shown: whether the summary of a population prints its quantiles.
        is_time: whether it says when a scenario has got where its objective wants it.
        is_beside: whether a ranking by the objective shows it beside it.
    """

    name: str
    label: str
    unit: str = ""
    better: Literal["low", "high"] = "low"
    is_objective: bool = False
    is_shown: bool = True
    is_time: bool = False
    is_beside: bool = False

    @property
    def title(self) -> str:
        """The label with the unit in brackets: the name of an axis, or of a table's row."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label

    @property
    def suffix(self) -> str:
        """The unit as it follows a number, with its space; empty where there is none."""
        return f" {self.unit.removeprefix('1')}" if self.unit else ""


ESTIMATES = (
    Score("mse", "MSE", "(N·m/rad)²", is_shown=False),
    Score("msrep", "MSREP", "%", is_objective=True),
    Score("mse_settled", "MSE after the warm-up", "(N·m/rad)²"),
    Score("msrep_settled", "MSREP after the warm-up", "%", is_objective=True),
    Score("convergence_time", "convergence time", "s", is_time=True),
    Score("max_relative_error", "largest relative error after the warm-up", is_shown=False),
    Score("coverage", "share of known samples inside the band", better="high"),
    Score("known_time", "first known", "s"),
    Score("known_share", "share of samples known", better="high", is_shown=False),
    Score("near_zero_share", "share of samples left out", is_shown=False),
)
"""Of an estimate: the fields of `vsajax.Scores`."""
SWINGS = (
    Score("settling_time", "settling time", "s", is_objective=True, is_time=True),
    Score("log_energy", "log-energy", is_objective=True),
    Score("decay_rate", "decay rate", "1/s", better="high", is_shown=False),
    Score("residual", "residual swing", "rad"),
    Score("peak", "largest swing", "rad", is_shown=False),
    Score("switches", "switches a second", "1/s"),
    Score("travel", "way of the stiffness", "ranges/s", is_shown=False),
)
"""Of a swing that dies out: the fields of `vsajax.SwingScores`."""
HANDS = (
    Score("stiffness_error", "relative error of the hand's stiffness", is_objective=True),
    Score("compliance_error", "relative error of the hand's compliance", is_objective=True),
    Score("stiffness_change", "relative change of the hand's stiffness from its design", is_objective=True),
)
"""Of the stiffness that an arm has at its hand."""
LOGS = (
    Score("agreement", "unexplained torque", "%", is_objective=True),
    Score("no_load", "torque without load", "%", is_objective=True),
    Score("rest", "objective on the rest of the log", "%", is_beside=True),
)
"""Of an estimator on a part of a robot's own log: how far its torque is from what it should be."""
_FAMILIES = (ESTIMATES, SWINGS, HANDS, LOGS)


class Scores(Registry[Score], Mapping[str, Score]):
    """The scores by name."""

    def __getitem__(self, name: str) -> Score:
        try:
            return self.find(name)
        except Refused:
            raise KeyError(name) from None

    def __iter__(self) -> Iterator[str]:
        return iter(dict.fromkeys([*super().__iter__(), *installed(self.name)]))

    def __len__(self) -> int:
        return len(list(iter(self)))

    def fitted(self, tag: str, entry: Any, origin: Origin | None) -> Score:
        """Return a foreign score under the name of its column."""
        if not isinstance(entry, Score):
            raise Refused(f"got {tag!r}, which leads to {entry!r:.80}", f"a score is a {Score.__module__}:Score")
        return entry._replace(name=tag)


SCORES = Scores("scores", {score.name: score for family in _FAMILIES for score in family})


def _or_foreign(name: Any, own: ValidatorFunctionWrapHandler) -> Any:
    try:
        return own(name)
    except ValidationError:
        if isinstance(name, str) and name in SCORES and SCORES[name].is_objective:
            return name
        raise


Objective = Annotated[
    Literal[
        "msrep",
        "msrep_settled",
        "log_energy",
        "settling_time",
        "stiffness_error",
        "compliance_error",
        "stiffness_change",
        "agreement",
        "no_load",
    ],
    WrapValidator(_or_foreign),
    PlainSerializer(lambda name: name),
]
"""Scores that a search can minimise: those of `SCORES` with `is_objective`."""


def title_of(name: str) -> str:
    """Return a score's label with its unit in brackets."""
    return SCORES[name].title


def unit_of(name: str) -> str:
    """Return a score's unit as it follows a number, with its space; nothing where it has none, or is no score."""
    return SCORES[name].suffix if name in SCORES else ""


def time_of(objective: str) -> str | None:
    """Return the score that says when a scenario with this objective has got there; `None` where nothing moves."""
    if SCORES.origin(objective) is not None:
        return objective
    family = next(family for family in _FAMILIES if SCORES[objective] in family)
    return next((score.name for score in family if score.is_time), None)
