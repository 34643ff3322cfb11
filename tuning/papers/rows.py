"""What a reproduction says: rows of printed beside measured numbers, and figures."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True)
class Row:
    """One number of a paper beside ours.

    Args:
        name: what it is.
        printed: the paper's number, or `None` where it prints none.
        measured: ours, computed now.
        unit: of both.
        low: smallest value that is accepted.
        high: largest value that is accepted.
        note: why the printed value cannot be met, and what the row is judged against instead.
    """

    name: str
    printed: float | None
    measured: float
    unit: str
    low: float
    high: float
    note: str = ""
    ok: bool = field(init=False)

    def __post_init__(self):
        """Judge the row."""
        object.__setattr__(self, "ok", self.low <= self.measured <= self.high)


@dataclass(frozen=True)
class Report:
    """A paper's rows and figures.

    Args:
        title: of the paper.
        rows: its numbers.
        figures: files that were drawn.
        findings: sentences that no single row holds.
    """

    title: str
    rows: list[Row]
    figures: list[Path]
    findings: list[str] = field(default_factory=list)

    @property
    def ok(self) -> bool:
        """Whether every row holds."""
        return all(row.ok for row in self.rows)
