"""Ranges of one number: the points of a grid, and the bounds of a search."""

from __future__ import annotations

import enum
import re
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, ValidationError, model_validator

from tuning.files.errors import input_error
from tuning.files.toml import Table

Scale = Literal["linear", "log"]
_SWITCHES = {"true": True, "false": False}
_WORD = re.compile(r"[A-Za-z_][^(),=\s]*")
_RANGE = re.compile(r"^(log|lin|linear)\(([^,]+),([^,]+),([^,]+)\)$")


class Reach(enum.Flag):
    """What a number changes at most."""

    TORQUE = enum.auto()
    """The torque signal that is explained."""
    REGRESSORS = enum.auto()
    """What explains it: where no number changes them, their covariance is shared by every value."""
    RECORDING = enum.auto()
    """What is measured and held against the estimate."""
    MOTION = enum.auto()
    """What moves: where no number changes it, the motion is simulated once."""


EVERYTHING = Reach.TORQUE | Reach.REGRESSORS | Reach.RECORDING | Reach.MOTION
"""What a number reaches of which nothing is known: that is slow, and never wrong."""


class Bounds(Table):
    """The interval in which a number is searched; with `only`, in those options of the study's choices alone."""

    low: float
    high: float
    scale: Scale = "log"
    points: Annotated[int, Field(ge=2)] = 5
    only: Annotated[list[str], Field(min_length=1)] | None = None

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.low < self.high:
            raise ValueError(f"low must be below high; got {self.low} and {self.high}")
        if self.scale == "log" and self.low <= 0:
            raise ValueError(f"a log range must be positive; got low = {self.low} (or use scale = 'linear')")
        return self

    def ends(self) -> tuple[float, float]:
        """Return both ends."""
        return self.low, self.high

    def grid(self) -> list[float]:
        """Return `points` values from low to high, evenly spaced on the scale."""
        space = np.geomspace if self.scale == "log" else np.linspace
        return [float(x) for x in space(self.low, self.high, self.points)]


class Axis(Table):
    """One axis of a grid: a list of values, a range, or `options` that are no numbers: texts and switches."""

    values: list[float] | None = None
    options: list[str | bool] | None = None
    low: float | None = None
    high: float | None = None
    points: Annotated[int, Field(ge=1)] | None = None
    scale: Scale = "log"

    @model_validator(mode="before")
    @classmethod
    def _from_list(cls, data: Any) -> Any:
        if not isinstance(data, list):
            return data
        return {"options" if any(isinstance(value, str | bool) for value in data) else "values": data}

    @model_validator(mode="after")
    def _complete(self) -> Self:
        span = (self.low, self.high, self.points)
        listed = self.values if self.options is None else self.options
        if (listed is None) == any(x is None for x in span) or None not in (self.values, self.options):
            raise ValueError("needs either a list of values, or low, high and points")
        if listed is not None and (not listed or len(set(listed)) < len(listed)):
            raise ValueError("needs at least one value, and each only once")
        if self.low is not None and self.high is not None and self.points != 1 and not self.low < self.high:
            raise ValueError(f"low must be below high; got {self.low} and {self.high}")
        if self.scale == "log" and self.low is not None and self.low <= 0:
            raise ValueError(f"a log range must be positive; got low = {self.low} (or use scale = 'linear')")
        return self

    def grid(self) -> list[float]:
        """Return the values."""
        if self.values is not None:
            return self.values
        space = np.geomspace if self.scale == "log" else np.linspace
        return [float(x) for x in space(self.low or 0.0, self.high or 0.0, self.points or 1)]

    @property
    def size(self) -> int:
        """Number of values, however many: none of them is made to count them."""
        listed = self.values if self.options is None else self.options
        return (self.points or 1) if listed is None else len(listed)

    def ends(self) -> tuple[float, float]:
        """Return the smallest and the largest value."""
        if self.values is not None:
            return min(self.values), max(self.values)
        low, high = self.low or 0.0, self.high or 0.0
        return low, low if self.points == 1 else high


def _listed(words: list[str]) -> list[Any]:
    """Return the values of a list on the command line: numbers, or, where one is none, texts and switches."""
    words = [word.strip() for word in words]
    try:
        return [float(word) for word in words]
    except ValueError:
        if any(not _WORD.fullmatch(word) for word in words):
            raise  # It says which of them is no number.
        return [_SWITCHES.get(word, word) for word in words]


def parse_axis(text: str) -> tuple[str, Axis]:
    """Return the path and axis of a command-line grid: `a.b=log(lo,hi,n)`, `lin(lo,hi,n)`, `1,2`, or `text,text`.

    Raises:
        InputError: the text is neither.
    """
    path, separator, values = (part.strip() for part in text.partition("="))
    fix = "e.g. --grid estimator.torque.observer_gain=log(10,1000,8), lin(0,1,5) or 1,2,5"
    if not separator or not path:
        raise input_error(f"--grid {text}", "is not of the form a.b=values", fix)
    match = _RANGE.match(values.replace(" ", ""))
    try:
        if match:
            scale: Scale = "log" if match[1] == "log" else "linear"
            return path, Axis(low=float(match[2]), high=float(match[3]), points=int(match[4]), scale=scale)
        return path, Axis.model_validate(_listed(values.split(",")))
    except ValueError as error:
        reason = error.errors()[0]["msg"] if isinstance(error, ValidationError) else str(error)
        raise input_error(f"--grid {text}", reason.removeprefix("Value error, "), fix) from None
