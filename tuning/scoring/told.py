"""What a kind says of a Monte Carlo run in its own words, in place of quantiles over all robots."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from tuning.pictures.page import Picture, Table


class Told(Protocol):
    """What a Monte Carlo run shows; it is made from the study and the `(scenario,)` columns of the run by name."""

    @property
    def is_ok(self) -> bool:
        """Whether any scenario has a score: without one the command ends with 1."""
        ...

    @property
    def headline(self) -> str:
        """The main number, as a sentence."""
        ...

    @property
    def picture_name(self) -> str:
        """What the picture's file in the run folder is called, without its ending."""
        ...

    def as_tables(self) -> Mapping[str, Any]:
        """Return it for machines."""
        ...

    def as_text(self) -> str:
        """Return it for people."""
        ...

    def table(self) -> Table:
        """Return the table of a report."""
        ...

    def picture(self) -> Picture:
        """Draw it."""
        ...
