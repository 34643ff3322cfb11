"""`vsajax init map LOG`: guesses that hold on real logs, with their reasons."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.tuning.logs.robot_logs import spring_log, wrapped
from tuning.files.errors import InputError
from tuning.files.whole import write_table
from tuning.logs.guess import propose, to_map
from tuning.logs.reading import read_recording

HEBI = Path(__file__).parents[2] / "golden" / "hebi" / "exampleLog.csv"


@pytest.mark.real
@pytest.mark.cli
def test_the_map_of_the_hebi_log_is_proposed_with_reasons_and_reads_it(vsajax, tmp_path):
    target = tmp_path / "map.toml"
    ended = vsajax("init", "map", HEBI, "-o", target, "--json")
    assert (ended.code, ended.err) == (0, "")
    guesses = {guess["name"]: guess for guess in json.loads(ended.out)["guesses"]}
    assert guesses["deflection"]["column"] == "deflection"
    assert guesses["elastic_torque"]["sign"] == -1
    assert guesses["motor_position"]["gear_ratio"] == pytest.approx(272.22, rel=0.005)
    text = target.read_text()
    assert "# sign -1, as it falls when the deflection rises" in text
    assert "SUPPOSED" in text
    table = read_recording(HEBI, target)
    assert table.faults == ()
    slope = np.polyfit(table.columns["deflection"], table.columns["elastic_torque"], 1)[0]
    assert slope == pytest.approx(40.0, rel=1e-9)
    again = vsajax("init", "map", HEBI, "-o", target)
    assert again.code == 2
    assert "exists already" in again.err


@pytest.mark.parametrize(
    ("clock", "scale", "unit"),
    [("time", 1.0, "s"), ("time_ms", 1e3, "ms"), ("stamp", 1e6, "us"), ("t_ns", 1e9, "ns")],
)
def test_units_signs_gears_and_wraps_are_seen(tmp_path, clock, scale, unit):
    columns = spring_log()
    # Turned until the counter starts again.
    degrees = np.rad2deg(columns["link"]) + 180.0
    log = {
        clock: np.round(scale * columns["time"]).astype(int) if scale > 1e4 else scale * columns["time"],
        "joint_position": wrapped(degrees, 360.0),
        "motor_pos_rad": -50 * columns["motor"],
        "spring_deflection_mrad": 1e3 * columns["deflection"],
        "torque_sensor_Nm": -columns["torque"],
        "torque_cmd": columns["torque"],
        "velocity": np.gradient(columns["link"]),
    }
    path = tmp_path / "log.parquet"
    write_table(path, log)
    proposal = propose(path)
    found = {guess.name: guess for guess in proposal.guesses}
    assert proposal.kind == "sea"
    assert proposal.lacking == ()
    assert proposal.clock[:2] == (clock, unit)
    assert found["link_position"].unit == "deg"
    assert found["link_position"].wraps_at == 360.0
    assert (found["motor_position"].column, found["motor_position"].unit) == ("motor_pos_rad", "rad")
    assert found["deflection"].unit == "mrad"
    assert (found["elastic_torque"].column, found["elastic_torque"].sign) == ("torque_sensor_Nm", -1)
    assert set(proposal.others) == {"torque_cmd", "velocity"}
    (tmp_path / "map.toml").write_text(to_map(proposal, path))
    table = read_recording(path, tmp_path / "map.toml")
    line = np.polyfit(table.columns["deflection"], table.columns["elastic_torque"], 1)
    assert line[0] == pytest.approx(80.0, rel=0.01)


def test_a_file_of_many_runs_is_cut_to_one(tmp_path):
    columns = spring_log()
    log = {name: np.concatenate([values, values, values]) for name, values in columns.items()}
    log["run"] = np.repeat(["a", "b", "c"], len(columns["time"]))
    path = tmp_path / "log.parquet"
    write_table(path, log)
    proposal = propose(path)
    assert proposal.select is not None
    assert proposal.select[:2] == ("run", "a")
    (tmp_path / "map.toml").write_text(to_map(proposal, path))
    assert read_recording(path, tmp_path / "map.toml").columns["time"].size == len(columns["time"])


@pytest.mark.failure
def test_what_is_missing_is_said_and_a_log_without_a_clock_refused(tmp_path):
    write_table(tmp_path / "log.csv", {"time": np.arange(9.0), "angle": np.sin(np.arange(9.0))})
    text = to_map(propose(tmp_path / "log.csv"), tmp_path / "log.csv")
    assert "# MISSING: no column looks like elastic_torque (or motor_torque)" in text
    write_table(tmp_path / "noise.csv", {"x": np.sin(np.arange(9.0)), "y": np.cos(np.arange(9.0))})
    with pytest.raises(InputError, match=r"noise\.csv: has no column that rises as a clock does"):
        propose(tmp_path / "noise.csv")
