"""The table of docs/exports.md: how far each exported format lies from jax, measured anew.

``python -m tuning.exports.deviations docs/exports.md`` exports the shipped configurations, takes what their checks
find, and writes the table between its markers.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from tuning.files.errors import input_error
from tuning.files.shipped import located
from tuning.files.whole import write_text

CONFIGS = ("serial", "antagonistic", "antagonistic_residual", "sea_sensor", "damping")
"""Shipped files."""
HEADER = ("configuration", "C, gcc and clang", "FMU", "StableHLO", "fused products alone", "single precision")
BEGIN = "<!-- written by python -m tuning.exports.deviations docs/exports.md -->"
END = "<!-- end of what was written -->"
_CHECKS = {"c99": ("gcc, double", "clang, double"), "fmi2": ("replay",), "stablehlo": ("step", "scan")}
"""Formats in the table's order, and the checks that compare with the golden recording."""


def measure(name: str, *, seconds: float) -> tuple[str, ...]:
    """Return a row of the table.

    Args:
        name: of a shipped configuration.
        seconds: length of the golden recording [s].

    Raises:
        InputError: a format does not hold.
    """
    from tuning.exports.deployable import load_deployable
    from tuning.exports.export import subject_of, write_export

    path = located(Path(f"shipped:{name}"))
    subject = subject_of(load_deployable(path), path, seconds=seconds)
    results: dict[str, list[dict[str, Any]]] = {}
    for target in _CHECKS:
        with tempfile.TemporaryDirectory() as place:
            done = write_export(subject, target, path, Path(place))
        if not done.ok:
            raise input_error(f"{name}, {target}", "does not hold", f"vsajax export shipped:{name} --to {target}")
        results[target] = done.results
    return row(f"`{path.parent.name}/{path.name}`", results, subject.golden.rounding)


def row(
    title: str, results: Mapping[str, Iterable[Mapping[str, Any]]], rounding: Mapping[str, float]
) -> tuple[str, ...]:
    """Return a row of the table from what the checks of each format found."""
    cells = [title]
    for target, names in _CHECKS.items():
        found = [one["figures"]["deviation"] for one in results[target] if one["name"] in names]
        cells.append(_worst(max(found, key=lambda deviation: max(deviation.values()))))
    single = next(one for one in results["c99"] if one["name"] == "single precision")["figures"]
    reals = {key: value for key, value in single["deviation"].items() if key not in single["differing"]}
    last = {key: single["final_deviation"][key] for key in reals if single["final_deviation"][key] is not None}
    lost = "".join(f"; {key} not finite" for key in single["not_finite"])
    return (*cells, _worst(rounding), f"{_worst(reals)}; at the end {_worst(last)}{lost}")


def _worst(deviation: Mapping[str, float]) -> str:
    name = max(deviation, key=lambda key: deviation[key])
    return f"{deviation[name]:.1e} ({name})" if deviation[name] else "0, every bit"


def table(rows: Iterable[tuple[str, ...]]) -> str:
    """Return the table as Markdown, between its markers."""
    lines = [HEADER, ("---",) * len(HEADER), *rows]
    return "\n".join([BEGIN, *(f"| {' | '.join(cells)} |" for cells in lines), END])


def replaced(page: str, written: str) -> str:
    """Return a page with the table between its markers replaced.

    Raises:
        InputError: it has no markers.
    """
    head, begin, rest = page.partition(BEGIN)
    _, end, tail = rest.partition(END)
    if not (begin and end):
        raise input_error("the page", "has no place for the table", f"write {BEGIN} and {END} into it")
    return head + written + tail


def main(page: Path, *, seconds: float = 10.0) -> None:
    """Measure every row and write the table into a page."""
    from tuning.runs.machine import start_jax

    start_jax()
    rows = []
    for name in CONFIGS:
        rows.append(measure(name, seconds=seconds))
        print(" | ".join(rows[-1]), flush=True)
    write_text(page, replaced(page.read_text(encoding="utf-8"), table(rows)))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
