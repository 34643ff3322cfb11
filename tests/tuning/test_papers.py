"""The papers in brief: rows that cost little are computed whole, and the duel's claims follow from its cells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tuning.papers import serial
from tuning.papers.antagonistic import model as pair
from tuning.papers.antagonistic import rows as antagonistic
from tuning.papers.cartesian import rows as cartesian
from tuning.papers.damping import rows as damping
from tuning.papers.duel import rows as duel
from tuning.papers.duel.cells import (
    ALGEBRAIC,
    CONSTANT,
    CONTENDERS,
    GIVEN,
    LEVELS,
    ODD,
    PRINTED,
    SETTINGS,
    UNFILTERED,
)
from tuning.papers.duel.figure import draw

BRIEF = {
    "serial, largest deflection of Fig. 3": serial._deflection_row,
    "antagonistic, motion": lambda: antagonistic._plant_rows(pair.R2),
    "damping, motion": damping._motion_rows,
    "cartesian, Table I in itself": cartesian._consistency_rows,
}
"""Rows of every paper but the duel, which has no cheap ones."""


@pytest.mark.parametrize("name", BRIEF)
def test_rows_that_cost_little_hold(name):
    found = BRIEF[name]()
    rows = found if isinstance(found, list) else [found]
    assert rows
    assert [row.name for row in rows if not row.ok] == []
    # A row can fail: beyond its own ends it does.
    for row in rows:
        assert not replace(row, measured=row.high + max(1.0, abs(row.high))).ok
        assert not replace(row, measured=float("nan")).ok


PLANTED = {
    "R1": {
        PRINTED: 10.0,
        UNFILTERED: 5.0,
        ALGEBRAIC: 1.0,
        GIVEN: 3.0,
        ODD: 2.0,
        CONSTANT: 2.5,
    },
    "R2": {
        PRINTED: 10.0,
        UNFILTERED: 5.0,
        ALGEBRAIC: 1.0,
        GIVEN: 3.0,
        ODD: 0.8,
        CONSTANT: 0.9,
    },
}
"""By excitation: each contender's mean squared error [(N·m/rad)²]."""


def cells_of(planted: dict[str, dict[str, float]]) -> list[duel.Cell]:
    """Return the cells of contenders that are so far off, each by its own draws."""
    rng = np.random.default_rng(0)
    cells = []
    for setting in SETTINGS:
        if setting.name not in planted:
            continue
        size = planted[setting.name]
        entries = {
            one.name: duel.Entry(
                size[one.name] * rng.lognormal(0.0, 0.1, (len(LEVELS), 64)),
                # Where the stiffness passes through zero the residual's relative error is the larger one.
                (3.0 if one.family == "residual" else 1.0) * rng.lognormal(0.0, 0.1, (len(LEVELS), 64)),
                np.full(len(LEVELS), size[one.name]),
                {},
            )
            for one in CONTENDERS
        }
        cells += [duel._cell(entries, setting, level) for level in range(len(LEVELS))]
    return cells


def test_the_duel_claims_what_its_cells_show_and_nothing_else(tmp_path):
    cells = cells_of(PLANTED)
    rows = duel._rows(cells)
    assert [row.name for row in rows if not row.ok] == []
    assert {cell.residual for cell in cells} == {ODD}
    verdicts = [duel._verdict(cell) for cell in cells]
    assert [verdict.rpartition(": ")[2] for verdict in verdicts] == ["algebraic wins"] * 6 + ["residual wins"] * 6
    assert draw(cells, tmp_path).read_bytes().startswith(b"\x89PNG")
    # With the families exchanged no claim about co-contraction holds.
    lost = {name: size | {ALGEBRAIC: 20.0} for name, size in PLANTED.items()}
    assert [row.ok for row in duel._rows(cells_of(lost))] == [False, True, True, True, True]
