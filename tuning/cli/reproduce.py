"""Reproducing the papers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tuning.cli.plugins import OpenChoice
from tuning.terminal.following import start
from tuning.terminal.options import JSON, QUIET, emit, table

if TYPE_CHECKING:
    from tuning.study.registry import Registry

_EXAMPLES = {"cartesian": "arm"}
"""The kind of study that a paper is on, where it has another name."""


def _papers() -> Registry[Any]:
    from tuning.papers import PAPERS

    return PAPERS


@click.command(epilog="Example: vsajax reproduce serial -o runs/serial")
@click.argument("paper", type=OpenChoice(_papers, "all"))
@click.option("-o", "--output", "folder", type=click.Path(path_type=Path), help="Folder for figures and rows.")
@JSON
@QUIET
def reproduce(paper: str, folder: Path | None, as_json: bool, quiet: bool) -> None:
    """Reproduce a paper's tables and figures, printed beside ours; exit 1 where a row does not hold."""
    from tuning.runs.machine import start_jax

    start_jax()
    from dataclasses import asdict

    from tuning.papers import reproduce_paper
    from tuning.study.kinds import KINDS

    reports = reproduce_paper(paper, folder)
    ok = all(report.ok for report in reports)
    rows = [asdict(row) for report in reports for row in report.rows]

    def text() -> str:
        lines = []
        for report in reports:
            lines.append(report.title)
            shown = [
                [
                    row.name,
                    "–" if row.printed is None else row.printed,
                    row.measured,
                    row.unit,
                    f"{row.low:.4g} … {row.high:.4g}",
                    "ok" if row.ok else "NOT MET",
                ]
                for row in report.rows
            ]
            lines.append(table(["row", "printed", "measured", "unit", "allowed", ""], shown))
            lines += [f"  {row.name}: {row.note}" for row in report.rows if row.note]
            lines += report.findings
            lines += [f"wrote {path}" for path in report.figures]
        return "\n".join(lines)

    result = {
        "study": paper,
        "ok": ok,
        "rows": rows,
        "findings": [finding for report in reports for finding in report.findings],
        "figures": [str(path) for report in reports for path in report.figures],
    }
    kind = _EXAMPLES.get(paper, paper if paper in KINDS.own() else "serial")
    emit(result, as_json=as_json, quiet=quiet, text=text, following=lambda: start(kind, kind))
    if not ok:
        raise click.exceptions.Exit(1)
