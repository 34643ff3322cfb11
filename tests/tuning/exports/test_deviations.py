"""The figures of docs/exports.md are those of a command."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.tuning.exports.families import FAMILIES, subject
from tests.tuning.exports.native import needs_compiler
from tuning.exports.deviations import BEGIN, CONFIGS, END, HEADER, replaced, row, table
from tuning.exports.export import write_export
from tuning.files.errors import InputError
from tuning.files.shipped import located

FIGURE = r"(0, every bit|\d\.\de[-+]\d\d \([\w.\[\]]+\))"


def rows_of(page: str) -> list[list[str]]:
    written = page.partition(BEGIN)[2].partition(END)[0]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in written.strip().splitlines()]


def test_the_documents_table_is_what_the_command_writes(request):
    page = (request.config.rootpath / "docs" / "exports.md").read_text(encoding="utf-8")
    header, _, *rows = rows_of(page)
    assert tuple(header) == HEADER
    paths = [located(Path(f"shipped:{name}")) for name in CONFIGS]
    assert [cells[0] for cells in rows] == [f"`{path.parent.name}/{path.name}`" for path in paths]
    for _, *figures, single in rows:
        assert all(re.fullmatch(FIGURE, figure) for figure in figures), figures
        assert re.fullmatch(rf"{FIGURE}; at the end {FIGURE}(; [\w.\[\]]+ not finite)*", single), single
    again = replaced(page, table(map(tuple, rows)))
    assert again == page


@needs_compiler
@pytest.mark.cli
def test_a_row_is_what_the_checks_found(tmp_path, monkeypatch, request):
    monkeypatch.setenv("PYTHONPATH", str(request.config.rootpath))
    made = subject("damping")
    path = FAMILIES["damping"][0]
    results = {
        target: write_export(made, target, path, tmp_path / target).results
        for target in ("c99", "fmi2", "stablehlo")
    }
    compiled = [one for one in results["c99"] if one["name"] == "gcc, double"]
    cells = row("`it`", results, {"stiffness": 2e-16, "motor_position": 0.0})
    assert len(cells) == len(HEADER)
    worst = max(compiled[0]["figures"]["deviation"].values())
    assert cells[1].startswith(f"{worst:.1e} (" if worst else "0, every bit")
    assert cells[4] == "2.0e-16 (stiffness)"
    assert rows_of(table([cells]))[2] == list(cells)


@pytest.mark.failure
def test_a_page_without_a_place_is_refused():
    with pytest.raises(InputError, match="has no place for the table"):
        replaced("# A page\n", table([]))
