"""What errors in the joints' stiffness cost at the hand, level by level."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from tuning.kinds.arm.study import ArmStudy
from tuning.pictures.page import Picture, Table
from tuning.pictures.style import ESTIMATE, OTHER, TRUTH, new_figure
from tuning.scoring.summary import define, has_failed
from tuning.study.scores import HANDS

_FROM_RUN = "run"
_ERRORS = tuple(score.name for score in HANDS)
_SHOWN = [f"{name}_{which}" for name in ("stiffness_error", "stiffness_change") for which in ("median", "q95")]
_HEADERS = ["joints' MSREP [%]", "hand against desired", "95 %", "hand against designed", "95 %", "failed"]


@dataclass(frozen=True)
class Accuracy:
    """A Monte Carlo run over an arm, level by level of its joints' MSREP.

    Args:
        study: of the arm.
        columns: of the run by name, `(scenario,)`: the level `msrep` [%], NaN at that of another run's robots, and
            the relative errors of the hand.
    """

    study: ArmStudy
    columns: Mapping[str, np.ndarray]
    picture_name = "accuracy"

    @cached_property
    def rows(self) -> list[dict[str, Any]]:
        """Median and 95 % quantile of the errors at each level, and the share that fails by each definition."""
        rows = summarise(self.columns)
        failures = self.study.population.failures
        for row in rows if failures else []:
            at = _at_level(self.columns, row["msrep"])
            own = {name: values[at] for name, values in self.columns.items()}
            row["failures"] = {name: float(has_failed(own, name, text).mean()) for name, text in failures.items()}
        return rows

    @property
    def is_ok(self) -> bool:
        """Whether any arm has a hand whose stiffness has a value."""
        return any(row["stiffness_error_median"] is not None for row in self.rows)

    @property
    def headline(self) -> str:
        """What the largest level costs."""
        told = [row for row in self.rows if row["stiffness_change_median"] is not None]
        if not told:
            return "No arm has a hand whose stiffness has a value."
        row = told[-1]
        at = (
            "the run's own MSREP" if row["msrep"] == _FROM_RUN else f"an MSREP of {row['msrep']:g} % in the joints"
        )
        change = _percent(row["stiffness_change_median"])
        return f"At {at} the hand's stiffness is off its design by {change} in the median."

    def as_tables(self) -> dict[str, Any]:
        """Return it for machines."""
        return {"ok": self.is_ok, "joints": list(self.study.chain.names), "levels": self.rows}

    def as_text(self) -> str:
        """Return it for people."""
        from tuning.terminal.options import table

        lost = "no arm has a hand whose stiffness has a value: `vsajax stiffness` says why for one pose"
        shown = self.table()
        return "\n".join([table(shown.headers, shown.rows), *([] if self.is_ok else [lost])])

    def table(self) -> Table:
        """Return the errors at each level."""
        failures = self.study.population.failures
        rows = [
            [
                row["msrep"],
                *(_percent(row[name]) for name in _SHOWN),
                row["failed"],
                *(_percent(row["failures"][name]) for name in failures),
            ]
            for row in self.rows
        ]
        defined = [define(name, text) for name, text in failures.items()]
        return Table("The hand's error by the joints'", [*_HEADERS, *defined], rows)

    def picture(self) -> Picture:
        """Draw how the errors grow with the level."""
        return Picture(
            "What accuracy costs",
            draw_accuracy(self.columns),
            "The error of the hand's stiffness against the error of the joints' stiffness that caused it.",
            self.headline,
        )


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{100.0 * value:.4g} %"


def _at_level(columns: Mapping[str, np.ndarray], level: float | str) -> np.ndarray:
    """Return which scenarios are at a level."""
    return np.isnan(columns["msrep"]) if level == _FROM_RUN else columns["msrep"] == level


def summarise(columns: Mapping[str, np.ndarray]) -> list[dict[str, Any]]:
    """Return median and 95 % quantile of the errors at each level, in order of the levels."""
    each, first = np.unique(columns["msrep"], return_index=True)
    levels = [_FROM_RUN if np.isnan(level) else float(level) for level in each[np.argsort(first)]]
    rows = []
    for level in levels:
        chosen = _at_level(columns, level)
        row: dict[str, Any] = {"msrep": level}
        for name in _ERRORS:
            values = columns[name][chosen]
            row["failed"] = int((~np.isfinite(values)).sum())
            kept = values[np.isfinite(values)]
            for label, q in (("median", 0.5), ("q95", 0.95)):
                row[f"{name}_{label}"] = float(np.quantile(kept, q)) if kept.size else None
        rows.append(row)
    return rows


def draw_accuracy(columns: Mapping[str, np.ndarray]) -> Figure:
    """Draw the errors of the hand against the MSREP of the joints."""
    medians = [f"{name}_median" for name in ("stiffness_error", "stiffness_change")]
    told = [row for row in summarise(columns) if all(row[name] is not None for name in medians)]
    rows = [row for row in told if row["msrep"] != _FROM_RUN and row["msrep"] > 0.0]
    figure, axis = new_figure(6.4, 3.8)
    levels = [row["msrep"] for row in rows]
    for name, label, colour in (
        ("stiffness_error", "against the desired stiffness", OTHER),
        ("stiffness_change", "against the designed stiffness", ESTIMATE),
    ):
        median, upper = ([100.0 * row[f"{name}_{which}"] for row in rows] for which in ("median", "q95"))
        axis.plot(levels, median, "o-", color=colour, label=f"{label}, median")
        axis.plot(levels, upper, "o--", color=colour, label="95 % of draws")
    for row in told:
        if row["msrep"] == _FROM_RUN:
            axis.axhline(100.0 * row["stiffness_change_median"], color=TRUTH, linewidth=0.9, linestyle=":")
            place = {"transform": axis.get_yaxis_transform(), "va": "bottom", "fontsize": 8}
            axis.text(0.02, 100.0 * row["stiffness_change_median"], "run, median", **place)
    if told:
        # Of nothing, and of errors that are all zero, there is no logarithm.
        axis.set(xscale="log", yscale="log")
    axis.set_xlabel("MSREP of the joints' stiffness [%]")
    axis.set_ylabel("relative error of the hand's stiffness [%]")
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, fontsize=8)
    return figure
