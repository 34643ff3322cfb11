"""The papers' tables and figures, computed and judged; one module a paper, and the duel of two."""

from __future__ import annotations

from pathlib import Path

from tuning.reproduce import antagonistic, cartesian, damping, duel, serial
from tuning.reproduce.report import Report, Row

__all__ = ["Report", "Row", "reproduce_paper"]

_PAPERS = {
    "serial": serial.reproduce,
    "antagonistic": antagonistic.reproduce,
    "damping": damping.reproduce,
    "cartesian": cartesian.reproduce,
    "duel": duel.reproduce,
}


def reproduce_paper(paper: str, folder: Path | None) -> list[Report]:
    """Reproduce one paper, or all; figures go to `folder`, or nowhere if it is `None`."""
    chosen = _PAPERS if paper == "all" else {paper: _PAPERS[paper]}
    return [run(None if folder is None else folder / name) for name, run in chosen.items()]
