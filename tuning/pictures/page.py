"""One HTML file from a headline, pictures and tables; it needs no other file, no network and no script."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass

import jinja2
import matplotlib as mpl
from matplotlib.figure import Figure

_LARGEST = 300_000
"""Bytes of a drawing from which it is sent as pixels."""


@dataclass(frozen=True)
class Picture:
    """A picture with what it shows.

    Args:
        title: what it is.
        figure: the drawing.
        caption: how to read it.
        alt: what it shows, in words, for those who do not see it.
    """

    title: str
    figure: Figure
    caption: str
    alt: str

    @property
    def address(self) -> str:
        """The drawing as a data address: lines, or pixels where those take less."""
        # Names of clip paths are drawn from the salt: the same report is the same file.
        with mpl.rc_context({"svg.hashsalt": "vsajax", "savefig.dpi": 150}):
            drawn = self._drawn("svg", Date=None)
            if len(drawn) <= _LARGEST:
                return f"data:image/svg+xml;base64,{base64.b64encode(drawn).decode()}"
            return f"data:image/png;base64,{base64.b64encode(self._drawn('png')).decode()}"

    def _drawn(self, kind: str, **metadata: str | None) -> bytes:
        file = io.BytesIO()
        self.figure.savefig(file, format=kind, metadata=metadata)
        return file.getvalue()


@dataclass(frozen=True)
class Table:
    """A table; numbers are shown with four digits.

    Args:
        title: what it is.
        headers: of the columns.
        rows: its cells.
        note: how to read it.
    """

    title: str
    headers: Sequence[str]
    rows: Sequence[Sequence[object]]
    note: str = ""

    @property
    def cells(self) -> list[list[str]]:
        """The cells as text."""
        return [[number(cell) if isinstance(cell, float) else str(cell) for cell in row] for row in self.rows]


@dataclass(frozen=True)
class Page:
    """A report.

    Args:
        title: its name.
        headline: the main numbers, in one or two sentences.
        pictures: in order.
        findings: further sentences.
        tables: in order.
        provenance: what it follows from.
        sources: titles and texts of whole files, folded up.
    """

    title: str
    headline: str
    pictures: Sequence[Picture]
    tables: Sequence[Table]
    provenance: Table
    findings: Sequence[str] = ()
    sources: Sequence[tuple[str, str]] = ()

    def html(self) -> str:
        """Return the file's text."""
        loader = jinja2.PackageLoader("tuning", "pictures")
        environment = jinja2.Environment(
            loader=loader, autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
        )
        return environment.get_template("template.html").render(page=self)


def number(value: float) -> str:
    """Return a number with four digits."""
    if math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    return f"{value:.4g}".replace("-", "−")


def valued(value: object) -> str:
    """Return a value of an axis: a number with four digits, a setting as it is."""
    return number(value) if isinstance(value, float) else str(value)


def span(low: float, high: float) -> str:
    """Return an interval; a dash where it is not known."""
    return "–" if math.isnan(low) and math.isnan(high) else f"{number(low)} … {number(high)}"


def signed(value: float) -> str:
    """Return a number with its sign."""
    return number(value) if value < 0 or math.isnan(value) else f"+{number(value)}"
