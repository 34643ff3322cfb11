"""The paper's numbers and figures, as a user asks for them."""

from __future__ import annotations

import json

import pytest

KEYS = {"name", "printed", "measured", "unit", "low", "high", "ok", "note"}


@pytest.mark.slow(twin="tests/tuning/test_papers.py::test_rows_that_cost_little_hold")
@pytest.mark.cli
@pytest.mark.statistical
def test_the_serial_paper_is_reproduced_with_its_figures(vsajax, tmp_path):
    ended = vsajax("reproduce", "serial", "-o", tmp_path, "--json")
    assert (ended.code, ended.err) == (0, "")
    result = json.loads(ended.out)
    assert (result["study"], result["ok"]) == ("serial", True)
    for row in result["rows"]:
        assert row.keys() == KEYS
        assert isinstance(row["measured"], float)
        assert row["ok"] is True
        # An open end is null.
        assert row["low"] <= row["measured"] <= (row["high"] if row["high"] is not None else float("inf"))
        # A printed number that is not met is explained.
        met = row["printed"] is None or row["low"] <= row["printed"] <= (row["high"] or float("inf"))
        assert met or row["note"], row["name"]
    names = " ".join(row["name"] for row in result["rows"])
    for words in ("MODEL MSREP", "SENSOR MSREP", "RESIDUAL MSREP", "printed RLS", "largest deflection"):
        assert words in names
    assert [path.rsplit("/", 1)[1][:4] for path in result["figures"]] == [f"fig{n}" for n in range(3, 9)]
    for path in result["figures"]:
        with open(path, "rb") as picture:
            assert picture.read(4) == b"\x89PNG"


@pytest.mark.slow(
    twin=(
        "tests/tuning/test_papers.py::test_rows_that_cost_little_hold",
        "tests/tuning/test_papers.py::test_the_duel_claims_what_its_cells_show_and_nothing_else",
    )
)
@pytest.mark.cli
@pytest.mark.parametrize(
    ("paper", "words", "pictures"),
    [
        ("antagonistic", ("chosen step", "T1 residual", "d.o.f.", "Legendre"), ["fig2", "fig3", "wind"]),
        (
            "damping",
            (
                "settling, law, events",
                "gain in energy rate over the law, 0.3/13",
                "arm, law",
                "believed 1.6 times",
            ),
            ["fig3", "fig4", "fig5", "fig6", "fig7", "fig8", "opti", "slew", "coni", "esti", "anta"],
        ),
        ("duel", ("R1: tuned residual over tuned algebraic", "R2, 1 mrad"), ["duel"]),
    ],
)
def test_the_other_papers_and_the_duel_are_reproduced(paper, words, pictures, vsajax, tmp_path):
    ended = vsajax("reproduce", paper, "-o", tmp_path, "--json")
    assert (ended.code, ended.err) == (0, "")
    result = json.loads(ended.out)
    assert (result["study"], result["ok"]) == (paper, True)
    names = " ".join(row["name"] for row in result["rows"])
    for text in words:
        assert text in names
    assert [path.rsplit("/", 1)[1][:4] for path in result["figures"]] == pictures
    if paper == "duel":
        # Three excitations at six levels, each with a verdict, and the table beside the picture.
        assert len(result["findings"]) == 18
        assert len((tmp_path / "duel" / "duel.csv").read_text().splitlines()) == 19
