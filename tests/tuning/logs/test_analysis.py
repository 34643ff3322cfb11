"""Rest, noise floor, gear, and voltages: what a log says besides its stiffness, from logs made to say it."""

from __future__ import annotations

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.tuning.logs.robot_logs import look_at, names, spring_log, write_spring_log
from tuning.logs.analysis import analyse, find_rest
from tuning.logs.reading import read_recording
from tuning.logs.signal_map import Drive

CONFIG = """
schema_version = 1
kind = "sea"
[estimator]
deflection = "measured"
matched = true
[estimator.torque]
type = "residual"
observer_gain = 20.0
motor_inertia = 2e-5
motor_damping = {damping}
gear_ratio = 50.0
[estimator.basis]
type = "odd"
deflection_scale = 0.02
deflection_offset = true
[estimator.fit]
prior_scale = 1e8
[estimator.gate]
min_deflection_range = 0.01
max_relative_std = 0.2
"""
MAP = """
schema_version = 1
kind = "sea"
[clock]
column = "t"
unit = "s"
{expect}
[signals.motor_position]
column = "motor"
unit = "rad"
[signals.deflection]
column = "deflection"
unit = "rad"
[signals.motor_torque]
column = "drive"
{drive}
"""
KT, KE, OHM, GEAR, STIFFNESS = 0.05, 0.05, 2.0, 50.0, 90.0


def voltage_log(samples: int = 6000) -> dict[str, np.ndarray]:
    """Return a DC motor that swings a spring: voltage from current and back EMF, in closed form."""
    rng = np.random.default_rng(4)
    time = np.cumsum(rng.uniform(0.8e-3, 1.2e-3, samples))
    time -= time[0]
    # At rest at first, so that the observer's start is exact.
    swing = 1.0 - np.cos(2 * np.pi * 1.1 * time)
    speed = 2 * np.pi * 1.1 * np.sin(2 * np.pi * 1.1 * time)
    acceleration = (2 * np.pi * 1.1) ** 2 * np.cos(2 * np.pi * 1.1 * time)
    deflection = 0.02 * (np.cos(2 * np.pi * 0.7 * time) - 1.0)
    # B γ θ'' = τ + τ_e/γ, on the motor's axis.
    torque = 2e-5 * GEAR * 0.3 * acceleration - STIFFNESS * deflection / GEAR
    voltage = OHM * torque / KT + KE * GEAR * 0.3 * speed
    return {"t": time, "motor": 0.3 * swing, "deflection": deflection, "drive": voltage}


def estimated(vsajax, folder, drive: str, *, damping: float = 0.0, expect: str = "") -> dict:
    pq.write_table(pa.table(voltage_log()), folder / "log.parquet")
    (folder / "map.toml").write_text(MAP.format(drive=drive, expect=expect))
    (folder / "config.toml").write_text(CONFIG.format(damping=damping))
    words = ("--map", folder / "map.toml", "-c", folder / "config.toml", "-o", folder / "out.parquet", "--json")
    ended = vsajax("estimate", folder / "log.parquet", *words)
    assert ended.code == 0, ended.err
    return json.loads(ended.out)


@pytest.mark.analytic
@pytest.mark.cli
def test_a_motors_voltage_finds_the_stiffness_with_the_back_emf_in_the_map_or_as_a_damping(vsajax, tmp_path):
    common = f"torque_constant = {KT}, resistance = {OHM}"
    in_map = f'unit = "V"\ndrive = {{ {common}, back_emf_constant = {KE}, gear_ratio = {GEAR} }}'
    found = estimated(vsajax, tmp_path, in_map)
    # Central differences of a 1.1 Hz swing at 1 ms, and trapezoids, are good to some 1e-4.
    assert found["final_stiffness"] == pytest.approx(STIFFNESS, rel=2e-3)
    assert found["final_known"] is True
    assert found["correlation"] > 0.9999
    # kt ke / R of the winding brakes the rotor as a damping does.
    damped = estimated(vsajax, tmp_path, f'unit = "V"\ndrive = {{ {common} }}', damping=KT * KE / OHM)
    assert damped["final_stiffness"] == pytest.approx(found["final_stiffness"], rel=2e-3)
    # Left out, it is taken for elastic torque.
    without = estimated(vsajax, tmp_path, f'unit = "V"\ndrive = {{ {common} }}')
    assert abs(without["final_stiffness"] / STIFFNESS - 1.0) > 0.05


@pytest.mark.cli
def test_a_torque_within_its_noise_floor_makes_no_stiffness_known(vsajax, tmp_path):
    drive = f'unit = "V"\ndrive = {{ torque_constant = {KT}, resistance = {OHM} }}'
    # The whole log is said to be without load: whatever the torque shows is then noise.
    found = estimated(vsajax, tmp_path, drive, expect="[expect]\nno_load = [0.0, 100.0]")
    assert found["known_share"] == 0.0
    assert found["noise_floor"]["limit"] > 0.1


def test_a_drives_torque_is_that_of_its_current():
    time = np.linspace(0.0, 1.0, 1001)
    drive = Drive(torque_constant=0.1, resistance=2.0, back_emf_constant=0.1, gear_ratio=10.0, efficiency=0.5)
    torque = drive.torque(np.full(1001, 12.0), time, 3.0 * time)
    np.testing.assert_allclose(torque, 0.5 * 0.1 * (12.0 - 0.1 * 30.0) / 2.0, rtol=1e-12)


def test_a_rest_is_found_with_its_noise_and_none_where_there_is_none():
    rng = np.random.default_rng(0)
    time = 0.002 * np.arange(3000)
    moved = np.where(time > 2.0, 0.05 * np.sin(3 * (time - 2.0)), 0.0)
    deflection = 0.1 + moved + 1e-4 * rng.normal(size=3000)
    torque = 50.0 * moved + 0.02 * rng.normal(size=3000)
    rest = find_rest(time, deflection, torque)
    assert rest is not None
    assert 1.9 < rest.until < 2.05
    assert rest.deflection == pytest.approx(0.1, abs=2e-5)
    assert rest.deflection_std == pytest.approx(1e-4, rel=0.15)
    assert rest.torque_std == pytest.approx(0.02, rel=0.15)
    assert find_rest(time, 0.05 * np.sin(3 * time), 2.5 * np.sin(3 * time)) is None
    # Noise in the regressor makes the slope too small by its share of the variance.
    assert rest.deflection_std**2 / np.var(deflection) < 1e-4


@pytest.mark.parametrize("ratio", [0.9, 1.0, 1.1])
def test_the_gear_ratio_is_that_at_which_link_and_motor_agree(tmp_path, ratio):
    columns = spring_log()
    columns |= {"motor": ratio * columns["motor"]}
    _, analysis = look_at(write_spring_log(tmp_path, columns))
    # The spring bends between them: what it adds does not follow the motor.
    assert analysis.gear_ratio == pytest.approx(ratio, rel=1e-6)
    assert ("wrong gear ratio" in names(analysis)) is (ratio != 1.0)


def test_a_canonical_log_is_analysed_too(tmp_path):
    columns = spring_log()
    canonical = {"link": "link_position", "motor": "motor_position", "torque": "elastic_torque"}
    path = tmp_path / "log.parquet"
    pq.write_table(pa.table({canonical.get(name, name): values for name, values in columns.items()}), path)
    table = read_recording(path)
    analysis = analyse(table, table.columns["deflection"], table.columns["elastic_torque"])
    assert analysis.characteristic is not None
    assert analysis.characteristic.stiffness == pytest.approx(80.0, rel=0.01)


@pytest.mark.failure
@pytest.mark.parametrize("reading", [1e160, -1e308])
@pytest.mark.parametrize("place", [slice(0, 1), slice(59, 60), slice(10, 12), slice(None)])
@pytest.mark.parametrize("signal", ["torque", "deflection", "link", "motor"])
def test_readings_whose_squares_overflow_are_named_by_row_and_left_out(tmp_path, signal, place, reading):
    columns = spring_log(samples=60)
    columns[signal][place] = reading
    _, analysis = look_at(write_spring_log(tmp_path, columns, ".parquet"))
    found = next(fault for fault in analysis.faults if fault.name == "out of range")
    first, last, _ = place.indices(60)
    rows = f"row {first + 1} (" if last == first + 1 else f"rows {first + 1} to {last} ("
    assert f"reaches {abs(reading):.3g} at {rows}" in found.problem
