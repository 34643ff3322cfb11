"""The papers' tables and figures, computed and judged; one module a paper, and the duel of two."""

from __future__ import annotations

from pathlib import Path

from tuning.papers import serial
from tuning.papers.antagonistic import rows as antagonistic
from tuning.papers.cartesian import rows as cartesian
from tuning.papers.damping import rows as damping
from tuning.papers.duel import rows as duel
from tuning.papers.rows import Report, Row

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
