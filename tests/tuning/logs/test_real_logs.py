"""The tuned kind of estimator over what real actuators logged, through the command."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from tuning.files.shipped import CONFIGS
from tuning.logs.analysis import analyse
from tuning.logs.reading import read_recording

CONFIG, LOGS = CONFIGS / "tuned" / "sea_sensor.toml", CONFIGS / "logs"
ROOT = Path(__file__).parents[3]
HEBI = ROOT / "tests" / "golden" / "hebi" / "exampleLog.csv"
TREGEAR = ROOT.parent / "shared" / "data" / "sea_tregear" / "runs.parquet"
SECOND_SPRING = [
    "kt-1-4-13-2-27022023-171453",
    "kt-1-5-14-2-27022023-171936",
    "kt-1-6-15-2-27022023-172030",
    "kt-2-4-16-2-27022023-172136",
    "kt-2-5-17-2-27022023-172319",
    "kt-2-6-18-2-27022023-172422",
]


def runs() -> list[str]:
    """Return the names of the 30 runs."""
    return list(dict.fromkeys(pq.read_table(TREGEAR, columns=["file"])["file"].to_pylist()))


@pytest.mark.real
@pytest.mark.cli
@pytest.mark.skipif(
    not TREGEAR.is_file(), reason=f"the SEA recordings may not be shipped and are not in {TREGEAR}"
)
@pytest.mark.parametrize(
    "run", [*SECOND_SPRING[:2], *(pytest.param(run, marks=pytest.mark.slow) for run in SECOND_SPRING[2:])]
)
def test_the_second_spring_is_found_with_its_band_and_only_after_it_moved(run, vsajax, tmp_path):
    output, signal_map = tmp_path / "estimate.parquet", LOGS / "sea_tregear.toml"
    words = ("estimate", TREGEAR, "--map", signal_map, "-c", CONFIG, "--select", f"file={run}", "-o", output)
    ended = vsajax(*words, "--json")
    assert (ended.code, ended.err) == (0, "")
    result = json.loads(ended.out)
    assert any("rows selected by file" in note for note in result["notes"])

    recording = read_recording(TREGEAR, signal_map, select={"file": run}).columns
    deflection, torque = recording["deflection"], recording["elastic_torque"]
    slope = np.polyfit(deflection, torque, 1)[0]
    # The prior weighs 1e-6 against 1e4 samples with features near one: nothing, beside rounding.
    assert result["final_stiffness"] == pytest.approx(slope, rel=1e-6)
    assert 2600.0 < slope < 2630.0
    # The band holds the slope, and is no wider than a percent.
    assert abs(result["final_stiffness"] - slope) <= 1.96 * result["final_stiffness_std"]
    assert 0.0 < 1.96 * result["final_stiffness_std"] < 0.01 * slope

    table = pq.read_table(output)
    time, known = table["time"].to_numpy(), table["known"].to_numpy()
    assert not known[time < 5.0].any()
    assert np.ptp(deflection[time < 5.0]) < 2e-4
    assert known[-1]
    assert result["known_from"] == time[np.argmax(known)] < 9.0


@pytest.mark.real
@pytest.mark.skipif(
    not TREGEAR.is_file(), reason=f"the SEA recordings may not be shipped and are not in {TREGEAR}"
)
def test_every_run_of_every_spring_is_a_line_or_is_said_to_be_none():
    """Without jax: the analysis of all 30 runs, whose final estimates the slow test beside this one compares."""
    signal_map, softest = LOGS / "sea_tregear.toml", {}
    for run in runs():
        columns = (table := read_recording(TREGEAR, signal_map, select={"file": run})).columns
        analysis = analyse(table, columns["deflection"], columns["elastic_torque"])
        line = analysis.characteristic
        assert line is not None
        slope = np.polyfit(columns["deflection"], columns["elastic_torque"], 1)[0]
        assert line.stiffness == pytest.approx(slope, rel=1e-9)
        assert analysis.faults == (), run
        assert analysis.rest is not None
        assert 4.5 < analysis.rest.until < 7.0
        assert table.clock.gaps[0].length > 0.2
        if line.is_line:
            assert line.causes == ()
            continue
        assert "hysteresis" in line.causes, run
        words = " ".join(analysis.sentences())
        assert "ONE STIFFNESS DOES NOT DESCRIBE THIS LOG" in words
        assert "HYSTERESIS" in words
        softest[run] = line
    # Three runs each of spring 1 at 3 and 4 N·m, and of spring 5 at 9 N·m.
    assert len(softest) == 9
    for run, line in softest.items():
        if run.startswith(("kt-4", "kt-9")):
            assert "softening" in line.causes
            assert line.swings[0].secant > 1.2 * line.swings[-1].secant


@pytest.mark.real
@pytest.mark.cli
@pytest.mark.slow(
    twin=(
        "test_every_run_of_every_spring_is_a_line_or_is_said_to_be_none",
        "test_the_hebi_log_has_the_stiffness_its_maker_set",
    )
)
@pytest.mark.skipif(
    not TREGEAR.is_file(), reason=f"the SEA recordings may not be shipped and are not in {TREGEAR}"
)
def test_the_estimate_of_every_run_is_least_squares_with_an_offset(vsajax, tmp_path):
    signal_map = LOGS / "sea_tregear.toml"
    for run in runs():
        columns = read_recording(TREGEAR, signal_map, select={"file": run}).columns
        page, output = tmp_path / "log.html", tmp_path / "estimate.parquet"
        words = ("estimate", TREGEAR, "--map", signal_map, "-c", CONFIG, "--select", f"file={run}", "-o", output)
        ended = vsajax(*words, "--report", page, "--json")
        assert (ended.code, ended.err) == (0, ""), run
        result = json.loads(ended.out)
        slope = np.polyfit(columns["deflection"], columns["elastic_torque"], 1)[0]
        if result["line"]["r_squared"] > 0.98:
            assert result["final_stiffness"] == pytest.approx(slope, rel=0.02), run
        else:
            assert {"hysteresis", "softening"} & set(result["line"]["causes"])
            assert "One number does not describe it" in page.read_text()
        page.unlink()


@pytest.mark.real
@pytest.mark.cli
def test_the_hebi_log_has_the_stiffness_its_maker_set(vsajax, tmp_path):
    words = ("estimate", HEBI, "--map", LOGS / "hebi.toml", "-c", CONFIG, "-o", tmp_path / "estimate.csv")
    ended = vsajax(*words, "--json")
    assert (ended.code, ended.err) == (0, "")
    result = json.loads(ended.out)
    # The log's effort is −40 times its deflection to the last digit; the prior costs 1e-6/1e3 and the digits 1e-9.
    assert result["final_stiffness"] == pytest.approx(40.0, rel=1e-7)
    assert result["final_known"] is True
    assert result["samples"] == 999
    assert result["faults"] == []
    # Another fit, of the motor's encoder over the link's, gave 273.2; the data sheet says 272.22.
    assert result["gear_ratio"] == pytest.approx(272.22, rel=0.005)
    assert result["gear_ratio"] == pytest.approx(273.2, rel=1e-3)
    assert "scores" not in result
    assert (tmp_path / "estimate.png").stat().st_size > 0
