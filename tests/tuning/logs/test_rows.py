"""Tables of several topics, each of which fills rows of its own."""

from __future__ import annotations

import numpy as np
import pytest

from tuning.files.errors import InputError
from tuning.logs.formats import read_streams
from tuning.logs.guess import propose, to_map
from tuning.logs.reading import read_recording

TIME = 0.005 * np.arange(80)
ANGLE = 0.02 * np.sin(20.0 * TIME)
LATE = TIME + 0.002
TORQUE = 120.0 * 0.02 * np.sin(20.0 * LATE)
MAP = """
schema_version = 1
kind = "sea"
[clock]
column = "__time"
unit = "s"
{clock}
{file}
[signals.deflection]
column = "/joint/deflection"
unit = "rad"
[signals.elastic_torque]
column = "/ft/torque"
unit = "N.m"
"""


def write(folder, lines):
    path = folder / "log.csv"
    path.write_text("\n".join(["__time,/battery,/joint/deflection,/ft/torque", *lines]) + "\n")
    return path


def topics(*, once: bool = False):
    """Return the lines of a file as PlotJuggler writes it; `once`: where one joint's row has the torque too."""
    rows = [(t, f"{t:.6f},,{a!r},") for t, a in zip(TIME.tolist(), ANGLE.tolist(), strict=True)]
    rows += [(t, f"{t:.6f},,,{x!r}") for t, x in zip(LATE.tolist(), TORQUE.tolist(), strict=True)]
    rows += [(t + 0.001, f"{t + 0.001:.6f},24.0,,") for t in (0.0, 0.1, 0.2, 0.3)]
    return [line + ("1.0" if once and i == 5 else "") for i, (_, line) in enumerate(sorted(rows))]


def read(path, clock: str = 'resample = "linear"', file: str = ""):
    (path.parent / "map.toml").write_text(MAP.format(clock=clock, file=file))
    return read_recording(path, path.parent / "map.toml")


def test_rows_of_one_table_are_split_by_topic_and_said(tmp_path):
    path = write(tmp_path, topics())
    assert len(read_streams(path)) == 3
    table = read(path)
    assert any("3 groups of columns" in note for note in table.notes)
    assert any("elastic_torque brought from 80 stamps of its own" in note for note in table.notes)
    # The clock is that of the mapped topic with most rows, not the battery's.
    time = table.columns["time"]
    assert time.size == 79
    np.testing.assert_allclose(np.diff(time), 0.005, atol=1e-9)
    np.testing.assert_allclose(table.columns["deflection"], ANGLE[1:], rtol=1e-15)
    # Linear between samples 5 ms apart of a sine of 20 rad/s: off by (ωh)²/8.
    np.testing.assert_allclose(table.columns["elastic_torque"], 120.0 * ANGLE[1:], atol=2.4 * 0.00125)
    with pytest.raises(InputError, match=r"sampled at other instants"):
        read(path, clock="")
    proposal = to_map(propose(path), path)
    assert "split_rows = true" in proposal
    (tmp_path / "proposed.toml").write_text(proposal)
    assert read_recording(path, tmp_path / "proposed.toml").columns["time"].size == 79


@pytest.mark.failure
def test_dropouts_are_no_topics(tmp_path):
    lines = [f"{t:.6f},1,{a!r},{60 * a!r}" for t, a in zip(TIME.tolist(), ANGLE.tolist(), strict=True)]
    lines[7], lines[30] = f"{TIME[7]:.6f},1,,0.5", f"{TIME[30]:.6f},1,0.5,"
    with pytest.raises(InputError, match=r"line 9: column '/joint/deflection' has no value"):
        read(write(tmp_path, lines))


@pytest.mark.failure
def test_what_may_be_either_names_the_key_that_decides(tmp_path):
    # Half of the torque's rows are the joint's too.
    lines = [f"{t:.6f},1,{a!r}," for t, a in zip(TIME.tolist(), ANGLE.tolist(), strict=True)]
    lines = [line + ("1.5" if i % 2 else "") for i, line in enumerate(lines)]
    lines += [f"{10 + t:.6f},1,,2.5" for t in TIME.tolist()]
    path = write(tmp_path, lines)
    with pytest.raises(InputError, match=r"has no value (?s:.*)split_rows = true in \[file\]"):
        read(path)
    assert len(read_streams(path)) == 1
    # Told so, each column has the rows that it fills.
    (tmp_path / "map.toml").write_text(MAP.format(clock='resample = "linear"', file="[file]\nsplit_rows = true"))
    table = read_recording(path, tmp_path / "map.toml")
    assert table.columns["time"].size == 40
