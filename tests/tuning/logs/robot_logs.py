"""A spring's log with everything in it, and what goes wrong with logs, for the tests of faults and of fuzzing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from tuning.logs.analysis import Analysis, analyse
from tuning.logs.reading import RecordingTable, read_recording

STIFFNESS, STEP = 80.0, 2e-3
MAP = """
schema_version = 1
kind = "sea"
[clock]
column = "time"
unit = "s"
[expect]
stiffness = [40.0, 160.0]
[signals.link_position]
column = "link"
unit = "rad"
{link}
[signals.motor_position]
column = "motor"
unit = "rad"
[signals.deflection]
column = "deflection"
unit = "rad"
[signals.elastic_torque]
column = "torque"
unit = "N.m"
{torque}
"""


def spring_log(*, samples: int = 400, amplitude: float = 0.1, seed: int = 0) -> dict[str, np.ndarray]:
    """Return the columns of a joint that swings, with noise and an arbitrary zero of the torque sensor."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(STEP * rng.uniform(0.8, 1.2, samples))
    phase = 2 * np.pi * time / (time[-1] - time[0])
    deflection = amplitude * (np.sin(3 * phase) + 0.3 * np.sin(7 * phase + 1.0)) + 1e-4 * rng.normal(size=samples)
    motor = 0.8 * np.sin(2 * phase)
    torque = STIFFNESS * deflection + 0.3 + 0.02 * rng.normal(size=samples)
    return {"time": time, "link": motor + deflection, "motor": motor, "deflection": deflection, "torque": torque}


def write_spring_log(folder: Path, columns: dict[str, np.ndarray], suffix: str = ".csv", **extra: str) -> Path:
    """Write a log, and its map beside it as map.toml."""
    path, table = folder / f"log{suffix}", pa.table(columns)
    if suffix == ".csv":
        pyarrow.csv.write_csv(table, path)
    else:
        pyarrow.parquet.write_table(table, path)
    (folder / "map.toml").write_text(MAP.format(**({"link": "", "torque": ""} | extra)))
    return path


def look_at(path: Path) -> tuple[RecordingTable, Analysis]:
    """Return a log read by the map beside it, and what its numbers say."""
    table = read_recording(path, path.parent / "map.toml")
    return table, analyse(table, table.columns["deflection"], table.columns["elastic_torque"])


def names(analysis: Analysis) -> set[str]:
    """Return the names of the faults found."""
    return {fault.name for fault in analysis.faults}


def wrapped(values: np.ndarray, period: float) -> np.ndarray:
    """Return what a counter that starts again at ± half a period shows."""
    return (values + period / 2) % period - period / 2


def with_gap(columns: dict[str, np.ndarray], place: int, length: float) -> dict[str, np.ndarray]:
    """Return a log whose clock pauses after a sample."""
    time = columns["time"].copy()
    time[place + 1 :] += length - (time[place + 1] - time[place])
    return columns | {"time": time}
