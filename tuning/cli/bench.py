"""Timings of the kernels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from tuning.terminal.following import words
from tuning.terminal.options import JSON, QUIET, emit, table

if TYPE_CHECKING:
    from tuning.bench.measure import Row


@click.command(epilog="Example: vsajax bench --against c")
@click.option("--against", type=click.Choice(["c"]), help="Compare with hand-written C; needs a C compiler.")
@click.option("--only", multiple=True, metavar="KERNEL", help="Measure this kernel; repeatable.")
@click.option(
    "--repeats",
    type=click.IntRange(min=1),
    default=7,
    show_default=True,
    help="Runs of each kernel, in turn with the other's.",
)
@click.option("--scaling", is_flag=True, help="Also measure how cost grows with lanes, steps, cores and grid.")
@click.option("--check", is_flag=True, help="Fail where a ratio to C is 1.25 times the recorded one; no limits.")
@click.option("--record", is_flag=True, help="Write the ratios to C into the record that --check reads.")
@JSON
@QUIET
def bench(
    against: str | None,
    only: tuple[str, ...],
    repeats: int,
    scaling: bool,
    check: bool,
    record: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Time the kernels, compilation apart; exit 1 where a limit or the agreement with C does not hold."""
    from tuning.runs.machine import start_jax

    start_jax()
    from dataclasses import asdict

    from tuning.bench.kernels import KERNELS
    from tuning.bench.measure import measure_kernel, measure_peak
    from tuning.bench.opponent import load_opponent
    from tuning.bench.record import compare_with, read_record, write_record
    from tuning.bench.scaling import measure_scaling
    from tuning.files.errors import input_error
    from tuning.terminal.progress import progress

    unknown = [name for name in only if name not in KERNELS]
    if unknown:
        raise input_error("--only", f"got {', '.join(unknown)}", f"allowed: {', '.join(KERNELS)}")
    recorded = read_record() if check else {}
    opponent = load_opponent() if against or check or record else None
    chosen = [kernel for name, kernel in KERNELS.items() if not only or name in only]
    if check:
        chosen = [kernel for kernel in chosen if (not only and kernel.name in recorded) or kernel.name in only]
    peak = None if opponent is None else measure_peak(opponent)
    rows = []
    with progress("kernels", len(chosen), quiet=quiet or as_json) as advance:
        for kernel in chosen:
            rows.append(measure_kernel(kernel, opponent, repeats=repeats, peak=peak))
            advance()
    points = measure_scaling() if scaling else []
    compared = compare_with(recorded, rows) if check else []
    judged = compared if check else rows
    ok = all(one.ok for one in (*judged, *points))
    wrote = [str(write_record(rows))] if record else []

    def text() -> str:
        lines = [_rows_table(rows)]
        lines += [f"  {row.kernel}: {row.note}" for row in rows if row.note and not check]
        if peak is not None:
            lines.append(f"floating-point peak of all cores, measured: {peak:.1f} flop/ns")
            lines += [f"  {row.kernel}, flop counted: {row.counting}" for row in rows if row.peak_share]
        if points:
            shown = [[p.kernel, p.axis, p.value, p.cost, p.unit, "ok" if p.ok else p.note] for p in points]
            lines.append(table(["kernel", "axis", "value", "cost", "unit", ""], shown))
        if check:
            shown = [[c.kernel, _cell(c.recorded), _cell(c.ratio), "ok" if c.ok else "WORSE"] for c in compared]
            lines.append(table(["kernel", "recorded", "now", ""], shown))
        return "\n".join([*lines, *(f"wrote {path}" for path in wrote)])

    result = {
        "ok": ok,
        "rows": [asdict(row) for row in rows],
        "peak_flop_per_ns": peak,
        "scaling": [asdict(point) for point in points],
        "check": [asdict(comparison) for comparison in compared],
        "files": wrote,
    }
    emit(result, as_json=as_json, quiet=quiet, text=text, following=words("doctor"))
    if not ok:
        raise click.exceptions.Exit(1)


def _cell(value: float | None, form: str = ".3g") -> str:
    return "–" if value is None else format(value, form)


def _rows_table(rows: Sequence[Row]) -> str:
    headers = [
        "kernel",
        "lanes",
        "compile (s)",
        "ns per step",
        "other's",
        "ratio",
        "limit",
        "of peak",
        "temp (MB)",
        "",
    ]
    shown = [
        [
            row.title,
            row.lanes,
            _cell(row.compile_s, ".2f"),
            _cell(row.ns_per_step, ".1f"),
            _cell(row.c_ns_per_step or row.base_ns_per_step, ".1f"),
            _cell(row.ratio),
            _cell(row.limit, "g") if row.ns_limit is None else f"{row.ns_limit:g} ns",
            _cell(row.peak_share, ".0%"),
            _cell(1e-6 * row.temp_bytes, ".1f"),
            "ok" if row.ok else "NOT MET",
        ]
        for row in rows
    ]
    return table(headers, shown)
