"""The report on one log: its stiffness, what one number cannot say, and what is wrong with the recording."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from tuning.kinds.log.answer import Answer
from tuning.kinds.log.pictures import draw_clock, draw_estimate, draw_levels, draw_loop
from tuning.logs.analysis import Analysis
from tuning.logs.characteristic import Characteristic
from tuning.logs.reading import RecordingTable
from tuning.logs.signal_map import Stiffness
from tuning.pictures.page import Page, Picture, Table, number, span
from tuning.runs.manifest import versions
from tuning.study.base import Config, resolved, study_hash, to_toml

_GAPS_SHOWN = 8


def report_log(answer: Answer, table: RecordingTable, config: Config, *, title: str) -> Page:
    """Return the page on an estimate over a log."""
    analysis = answer.analysis
    warnings = [s for s in answer.sentences if s.startswith(("WARNING", "ONE STIFFNESS"))]
    others = [s for s in answer.sentences if s not in warnings]
    return Page(
        title=f"log: {title}",
        headline=_headline(answer.summary, analysis),
        pictures=list(_pictures(answer, table, analysis, title)),
        tables=[one for one in _tables(answer.summary, table, analysis) if one.rows or one.note],
        findings=[*warnings, *others, *table.notes],
        provenance=Table(
            "",
            (),
            [
                ["log", table.source],
                ["estimator", f"{config.name}, hash {study_hash(config)}"],
                *([name, version] for name, version in versions().items()),
            ],
        ),
        sources=[
            ("The signal map", to_toml(table.signal_map.model_dump(exclude_none=True))),
            ("The estimator", to_toml(resolved(config))),
        ],
    )


def _headline(summary: Mapping[str, Any], analysis: Analysis | None) -> str:
    if summary["diverged"]:
        said = "The estimate diverged."
    elif not summary["known_share"]:
        said = f"The stiffness is not known: {summary['unknown_because']}."
    else:
        doubt = "" if summary["final_known"] else ", but it is no longer known at the end"
        said = (
            f"Stiffness {number(summary['final_stiffness'])} ± {number(2.0 * summary['final_stiffness_std'])} "
            f"N·m/rad (two standard deviations of the fit){doubt}."
        )
    line = None if analysis is None or analysis.is_faulty else analysis.characteristic
    if analysis is not None and line is not None and not line.is_line:
        if analysis.causes:
            causes = " and ".join(analysis.causes)
            said += f" One number does not describe it, R² {line.r_squared:.3f}: {causes}."
        else:
            said += f" R² {line.r_squared:.3f}."
    faults = summary["faults"]
    if faults:
        said += f" Something is wrong with the log: {', '.join(dict.fromkeys(f['name'] for f in faults))}."
    return said


def _pictures(answer: Answer, table: RecordingTable, analysis: Analysis | None, title: str) -> Iterator[Picture]:
    summary = answer.summary
    yield Picture(
        "Stiffness, torque and deflection",
        draw_estimate(answer, table, title=title),
        "Grey: not known yet, or no longer. The band is two standard deviations of the fit; it knows of no error "
        "of the model, and was not checked against any truth.",
        f"Estimate over {number(float(table.columns['time'][-1]))} s; at the end "
        f"{number(summary['final_stiffness'])} N·m/rad.",
    )
    line = None if analysis is None else analysis.characteristic
    if analysis is not None and line is not None:
        yield Picture(
            "Torque over deflection",
            draw_loop(analysis.deflection, analysis.torque, line),
            "Two colours apart are hysteresis; a bend is softening or stiffening.",
            f"Torque over deflection with a line of {number(line.stiffness)} N·m/rad, R² {line.r_squared:.4f}; "
            f"the loop is {number(line.width)} N·m wide.",
        )
        yield Picture(
            "Stiffness over amplitude",
            draw_levels(line),
            "Where these lie on one level, one stiffness is enough. Secants of swings fall where dry friction "
            "in the spring gives way.",
            "Secants and tangents: "
            + "; ".join(f"{_mrad(s.amplitude)} mrad {number(s.secant)}" for s in line.swings),
        )
    yield Picture(
        "The clock",
        draw_clock(table.columns["time"], table.clock),
        f"Median step {number(1e3 * table.clock.median)} ms; 99 % are below {number(1e3 * table.clock.slow)} ms; "
        f"{len(table.clock.gaps)} gaps, {number(table.clock.missing)} s in all without samples.",
        f"Time steps over time, with {len(table.clock.gaps)} gaps.",
    )


def _tables(summary: Mapping[str, Any], table: RecordingTable, analysis: Analysis | None) -> Iterator[Table]:
    yield _tabulate_signals(table)
    if analysis is not None:
        yield _tabulate_noise(analysis)
        if analysis.characteristic is not None:
            yield _tabulate_levels(analysis.characteristic)
            yield _tabulate_line(analysis.characteristic)
    gaps = [
        [gap.start, 1e3 * gap.length, gap.length / table.clock.median] for gap in table.clock.gaps[:_GAPS_SHOWN]
    ]
    more = len(table.clock.gaps) - len(gaps)
    yield Table(
        "The longest gaps", ("from [s]", "length [ms]", "median steps"), gaps, f"{more} more" if more else ""
    )
    yield Table(
        "What is wrong",
        ("how bad", "what", "signal", "what the numbers say", "way out"),
        [
            [fault[key] for key in ("severity", "name", "signal", "problem", "fix")]
            for fault in (*summary["faults"], *summary["remarks"])
        ],
    )


def _tabulate_signals(table: RecordingTable) -> Table:
    rows: list[list[object]] = []
    for name, signal in table.signal_map.signals.given().items():
        values = table.columns[name]
        step = table.resolutions.get(name, math.nan)
        unit = "N·m/rad" if isinstance(signal, Stiffness) else ("N·m" if name.endswith("torque") else "rad")
        rows.append([name, signal.column, signal.unit, span(float(values.min()), float(values.max())), unit, step])
    return Table(
        "Signals",
        ("signal", "column", "unit there", "from … to", "in", "resolution"),
        rows,
        "The resolution is the step of which all changes are multiples, where there is one.",
    )


def _tabulate_noise(analysis: Analysis) -> Table:
    rows: list[list[object]] = []
    if (rest := analysis.rest) is not None:
        rows.append(["at rest", f"0 … {number(rest.until)}", 1e3 * rest.deflection_std, rest.torque_std, "–"])
    if (floor := analysis.floor) is not None:
        limit = f"{number(floor.bias)} ± {number(floor.limit)}"
        rows.append(["without load", span(floor.start, floor.end), math.nan, floor.std, limit])
    headers = ("where", "time [s]", "deflection, std [mrad]", "torque, std [N·m]", "99.9 % of it [N·m]")
    note = (
        "" if rows else "The log starts in motion, and its map tells of no stretch without load (expect.no_load)."
    )
    return Table("Noise", headers, rows, note)


def _tabulate_levels(line: Characteristic) -> Table:
    rows = [[1e3 * level.amplitude, level.secant, level.tangent] for level in line.levels]
    swings = [[1e3 * swing.amplitude, swing.secant] for swing in line.swings]
    filled: list[list[object]] = []
    for i in range(max(len(rows), len(swings))):
        filled.append([*(rows[i] if i < len(rows) else ["–"] * 3), *(swings[i] if i < len(swings) else ["–"] * 2)])
    headers = (
        "from rest [mrad]",
        "secant [N·m/rad]",
        "tangent [N·m/rad]",
        "swing from a turn [mrad]",
        "secant [N·m/rad]",
    )
    return Table("Stiffness over amplitude", headers, filled, "Midway between the branches of a loop.")


def _tabulate_line(line: Characteristic) -> Table:
    reach = np.array([level.amplitude for level in line.levels]).max()
    return Table(
        "What one line leaves",
        ("of torque over deflection", "value"),
        [
            ["least squares with an offset [N·m/rad]", line.stiffness],
            ["R²", f"{line.r_squared:.5f}"],
            ["of the rest, a curve explains [%]", 100 * line.curvature],
            ["loading and unloading apart explain [%]", 100 * line.branches],
            ["both together [%]", 100 * line.both],
            ["widest gap between them [N·m]", line.width],
            ["loss a cycle [J]", line.loss],
            ["loss factor", line.loss_factor],
            ["zero moved from start to end [mrad]", 1e3 * line.shift],
            ["deflection at rest [mrad]", 1e3 * line.center],
        ],
        f"Loop and loss over the whole range, {number(1e3 * float(reach))} mrad about rest.",
    )


def _mrad(angle: float) -> str:
    return number(1e3 * angle)
