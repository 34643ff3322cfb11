"""The committed record of ratios to C, and the guard that they do not get worse."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tuning.bench.measure import Row
from tuning.bench.opponent import BENCHMARKS, processor
from tuning.files.errors import input_error
from tuning.runs.machine import usable_cores

RECORD = BENCHMARKS / "record.json"
WORSE = 1.25
"""A ratio may grow by this factor before the check fails."""


@dataclass(frozen=True)
class Comparison:
    """A kernel's ratio to C beside the recorded one.

    Args:
        kernel: its name.
        ratio: measured now; `None` where results disagree, so that nothing was timed.
        recorded: in the record; `None` for a kernel that it lacks.
        allowed: largest ratio that passes.
        ok: whether it does.
    """

    kernel: str
    ratio: float | None
    recorded: float | None
    allowed: float | None
    ok: bool


def read_record(path: Path = RECORD) -> dict[str, float]:
    """Return the recorded ratios by kernel.

    Raises:
        InputError: there is no record, or it is not one.
    """
    fix = "write one on a quiet machine: vsajax bench --record"
    try:
        ratios = json.loads(path.read_text(encoding="utf-8"))["ratios"]
        return {str(name): float(ratio) for name, ratio in ratios.items()}
    except OSError:
        raise input_error(str(path), "no such record", fix) from None
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise input_error(str(path), f"not a record of ratios: {error}", fix) from None


def write_record(rows: Sequence[Row], path: Path = RECORD) -> Path:
    """Write the ratios to C of some rows, beside those of other kernels that are recorded already."""
    try:
        kept = read_record(path) if path.is_file() else {}
    except ValueError:
        kept = {}
    ratios = kept | {row.kernel: round(row.ratio, 4) for row in rows if row.c_ns_per_step and row.ratio}
    name = processor().partition(":")[2].strip() if ":" in processor() else processor()
    record = {"cores": usable_cores(), "processor": _model(name), "ratios": ratios}
    path.write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
    return path


def compare_with(recorded: Mapping[str, float], rows: Sequence[Row]) -> list[Comparison]:
    """Return each row with a C twin beside its record; a kernel without a record passes."""
    compared = []
    for row in rows:
        if row.difference is None:
            continue
        before = recorded.get(row.kernel)
        allowed = None if before is None else WORSE * before
        ok = row.ratio is not None and (allowed is None or row.ratio <= allowed)
        compared.append(Comparison(row.kernel, row.ratio, before, allowed, ok))
    return compared


def _model(text: str) -> str:
    lines = [line for line in processor().splitlines() if line.startswith("model name")]
    return lines[0].partition(":")[2].strip() if lines else text.splitlines()[0]
