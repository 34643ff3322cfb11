"""The page beside an export: what it is, how to use it, its signals and parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tuning.exports.artefact import Artefact, Subject
from tuning.exports.layout import dotted
from tuning.exports.rendering import render


def readme_of(
    subject: Subject, artefact: Artefact, manifest: dict[str, Any], results: Sequence[dict[str, Any]]
) -> str:
    """Return the page as Markdown.

    Args:
        subject: what is exported.
        artefact: what was made of it.
        manifest: of the export.
        results: of its checks; none before they have run.
    """
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
        single=next((row for row in map(told_of_single_precision, results) if row), None),
    )


def told_of_single_precision(result: dict[str, Any]) -> dict[str, Any] | None:
    """Return what the check of single precision found, output by output; `None` of any other."""
    figures = result.get("figures", {})
    if "not_finite" not in figures or "differing" not in figures:
        return None
    rows = [
        {
            "name": name,
            "worst": f"{worst:.2g}",
            "final": "not finite"
            if figures["final_deviation"][name] is None
            else f"{figures['final_deviation'][name]:.2g}",
            "lost": figures["not_finite"].get(name, 0),
        }
        for name, worst in figures["deviation"].items()
        if name not in figures["differing"] and (worst or name in figures["not_finite"])
    ]
    return {
        "told": result["what"].removeprefix("stated, not judged: "),
        "rows": rows,
        "differing": figures["differing"],
    }


def number(value: Any) -> str:
    """Return a number, or a list of them, for people."""
    if isinstance(value, list):
        return f"[{', '.join(number(inner) for inner in value)}]"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
