"""The page beside an export: what it is, how to use it, its signals and parameters."""

from __future__ import annotations

from typing import Any

from tuning.exports.artefact import Artefact, Subject
from tuning.exports.layout import dotted
from tuning.exports.rendering import render


def readme_of(subject: Subject, artefact: Artefact, manifest: dict[str, Any]) -> str:
    """Return the page as Markdown."""
    limits = subject.program.limits
    rows = zip(manifest["parameters"], limits.ranges, strict=True)
    parameters = [row | {"range": one.text} for row, one in rows]
    return render(
        "README.md",
        title=subject.program.title,
        banner=subject.banner,
        manifest=manifest | {"parameters": parameters},
        orders=[(dotted(one.lower), "<" if one.is_strict else "≤", dotted(one.upper)) for one in limits.orders],
        usage=artefact.usage,
        number=number,
    )


def number(value: Any) -> str:
    """Return a number, or a list of them, for people."""
    if isinstance(value, list):
        return f"[{', '.join(number(inner) for inner in value)}]"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
