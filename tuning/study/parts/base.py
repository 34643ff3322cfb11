"""The tables of a study that describe modules of vsajax, field by field under the same names.

A number's path in the file, e.g. ``estimator.torque.observer_gain``, is its path in the built module; `build`
needs no code per class. Units are SI throughout.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, ClassVar

from pydantic import Field, model_validator

from tuning.files.toml import Table
from tuning.study.plugins import Origin
from tuning.study.refs import Ref

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Scale = Annotated[float, Field(ge=1e-6, le=1e6)]
AtLeastOne = Annotated[int, Field(ge=1)]
Fraction = Annotated[float, Field(gt=0, le=1)]


class Part(Table):
    """A table that becomes the class that `target` leads to, with its fields as arguments.

    The numbers named in `static` shape the compiled program; all others are array leaves and can be varied. The
    texts named in `files` are paths of files whose contents determine results.
    """

    target: ClassVar[Ref]
    origin: ClassVar[Origin | None] = None
    """Where a foreign part comes from; `None` of those of vsajax."""
    static: ClassVar[frozenset[str]] = frozenset()
    files: ClassVar[tuple[str, ...]] = ()
    ordered: ClassVar[tuple[str, str, str] | None] = None
    """A number, another that it must be below, and their unit."""

    @model_validator(mode="after")
    def _is_ordered(self) -> Part:
        if self.ordered is not None:
            lower, upper, unit = self.ordered
            low, high = getattr(self, lower), getattr(self, upper)
            if low >= high:
                raise ValueError(f"{lower} must be below {upper}; got {low} and {high} {unit}")
        return self

    @property
    def tag(self) -> str:
        """What tells it from the other parts that may stand in its place; empty where there are none."""
        return getattr(self, "type", "")

    def arguments(self) -> dict[str, Any]:
        """Return the constructor's arguments: every field but the tag `type`."""
        return {name: getattr(self, name) for name in type(self).model_fields if name != "type"}


def parts_in(value: Any) -> Iterator[Part]:
    """Return every part of a table, itself among them, from the outside in."""
    if isinstance(value, Part):
        yield value
    if isinstance(value, Table):
        for name in type(value).model_fields:
            yield from parts_in(getattr(value, name))
