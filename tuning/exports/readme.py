"""The page beside an export: what it is, how to use it, its signals and parameters."""

from __future__ import annotations

from typing import Any

from tuning.exports.artefact import Artefact, Subject
from tuning.exports.rendering import render


def readme_of(subject: Subject, artefact: Artefact, manifest: dict[str, Any]) -> str:
    """Return the page as Markdown."""
    parameters = [row | {"range": _range(row)} for row in manifest["parameters"]]
    return render(
        "README.md",
        title=subject.program.title,
        banner=subject.banner,
        manifest=manifest | {"parameters": parameters},
        usage=artefact.usage,
        number=number,
    )


def number(value: Any) -> str:
    """Return a number, or a list of them, for people."""
    if isinstance(value, list):
        return f"[{', '.join(number(inner) for inner in value)}]"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _range(row: dict[str, Any]) -> str:
    left = "" if row["low"] is None else f"{row['low']:g} {'<' if row['is_low_open'] else '≤'} "
    right = "" if row["high"] is None else f" {'<' if row['is_high_open'] else '≤'} {row['high']:g}"
    return f"{left}x{right}" if left or right else "any"
