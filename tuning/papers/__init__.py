"""The papers' tables and figures, computed and judged; one module a paper, and the duel of two."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tuning.files.errors import input_error
from tuning.papers.rows import Report, Row
from tuning.study.plugins import Refused
from tuning.study.refs import Explained, Ref
from tuning.study.registry import Registry

__all__ = ["PAPERS", "Report", "Row", "reproduce_paper"]

PAPERS: Registry[Any] = Registry(
    "papers",
    {
        "serial": Explained(
            Ref("tuning.papers.serial:reproduce"),
            "Flacco, De Luca, Sardellitti, Tsagarakis: stiffness of a serial joint.",
        ),
        "antagonistic": Explained(
            Ref("tuning.papers.antagonistic.rows:reproduce"), "Ménard, Grioli, Bicchi: an observer of two."
        ),
        "damping": Explained(
            Ref("tuning.papers.damping.rows:reproduce"), "Gasparri et al.: damping by stiffness."
        ),
        "cartesian": Explained(
            Ref("tuning.papers.cartesian.rows:reproduce"), "Petit, Albu-Schäffer: stiffness of a hand."
        ),
        "duel": Explained(
            Ref("tuning.papers.duel.rows:reproduce"), "The first two papers' estimators, side by side."
        ),
    },
)
"""Where what reproduces each paper is defined; of a foreign one, the function: it takes a folder, or `None`."""


def reproduce_paper(paper: str, folder: Path | None) -> list[Report]:
    """Reproduce one paper, or all of vsajax; figures go to `folder`, or nowhere if it is `None`.

    Raises:
        InputError: there is no such paper, or it cannot be imported.
    """
    try:
        chosen = PAPERS.own() if paper == "all" else {paper: PAPERS.find(paper)}
    except Refused as refused:
        raise input_error(f"PAPER {paper}", refused.problem, refused.fix) from None
    runs = {name: found.ref.load() if isinstance(found, Explained) else found for name, found in chosen.items()}
    return [run(None if folder is None else folder / name) for name, run in runs.items()]
