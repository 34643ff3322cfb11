"""Clocks as they go wrong and as files hold them: set on the way, without digits, dates, two columns."""

from __future__ import annotations

import datetime
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from scipy.io import savemat

from tuning.files.errors import InputError
from tuning.logs.guess import propose, to_map
from tuning.logs.reading import read_recording

CASES = Path(__file__).parents[4] / "shared" / "cases" / "logs"
TIME = 0.005 * np.arange(60)
DEFLECTION = 0.02 * np.sin(30.0 * TIME)
TORQUE = 120.0 * DEFLECTION
NOW = 1_700_000_000

MAP = """
schema_version = 1
kind = "sea"
[clock]
column = "time"
{clock}
[signals.deflection]
column = "deflection"
unit = "rad"
[signals.elastic_torque]
column = "elastic_torque"
unit = "N.m"
"""


def read(folder: Path, time, clock: str = 'unit = "s"', **more):
    columns = {"time": time, "deflection": DEFLECTION, "elastic_torque": TORQUE, **more}
    pa.parquet.write_table(pa.table(columns), folder / "log.parquet")
    (folder / "map.toml").write_text(MAP.format(clock=clock))
    return read_recording(folder / "log.parquet", folder / "map.toml")


def message(folder: Path, time, clock: str = 'unit = "s"', **more) -> str:
    with pytest.raises(InputError) as caught:
        read(folder, time, clock, **more)
    return str(caught.value)


def from_1970(samples: int, *, step: float = 0.005) -> np.ndarray:
    """Return stamps of a robot whose clock was set after so many samples."""
    return np.concatenate([step * np.arange(samples), NOW + TIME[samples:]])


@pytest.mark.parametrize("early", [1, 7])
def test_a_clock_that_was_set_is_a_fault_and_the_part_after_it_is_read(tmp_path, early):
    table = read(tmp_path, from_1970(early) + 100.0 * (early > 1) * (from_1970(early) < NOW))
    (fault,) = table.faults
    assert fault.name == "clock set"
    assert f"(row {early})" in fault.problem
    assert f"(row {early + 1})" in fault.problem
    assert "years" in fault.problem
    assert "not_before" in fault.fix
    assert not any("largest gap" in note for note in table.notes)
    since = fault.fix.partition("clock.not_before = ")[2].split()[0]
    after = read(tmp_path, from_1970(early), f'unit = "s"\nnot_before = {since}')
    assert after.faults == ()
    assert after.columns["time"].size == TIME.size - early
    assert any(f"{early} samples before" in note for note in after.notes)


def test_another_time_zone_is_a_clock_that_was_set(tmp_path):
    time = NOW + TIME
    time[30:] += 3600.0
    (fault,) = read(tmp_path, time).faults
    assert "jumps by 1 h" in fault.problem


def test_a_pause_is_a_gap_and_no_fault(tmp_path):
    time = TIME.copy()
    time[30:] += 20.0
    table = read(tmp_path, time)
    assert table.faults == ()
    assert any("largest gap" in note for note in table.notes)


@pytest.mark.failure
def test_a_clock_that_stood_until_it_was_set_is_not_mended_by_dropping_duplicates(tmp_path):
    time = np.concatenate([np.zeros(5), NOW + TIME[5:]])
    said = message(tmp_path, time)
    assert "stood at 0.0 for 5 samples, until it was set" in said
    assert "drop_duplicates" not in said
    since = said.partition("clock.not_before = ")[2].split()[0]
    assert read(tmp_path, time, f'unit = "s"\nnot_before = {since}').columns["time"].size == 55


@pytest.mark.failure
def test_stamps_that_never_ran_or_lost_their_digits_or_were_written_twice_are_told_apart(tmp_path):
    assert "its clock never ran" in message(tmp_path, np.zeros(60))
    assert "clock.nominal_step" in message(tmp_path, (NOW + TIME).astype(np.float32))
    rounded = NOW + np.floor(100.0 * TIME) / 10.0
    said = message(tmp_path, rounded)
    assert "lost their digits" in said
    assert "clock.nominal_step" in said
    assert "drop_duplicates" not in said
    # The samples are there twice, readings and all.
    twice = np.repeat(np.arange(30), 2)
    columns = {"deflection": DEFLECTION[twice], "elastic_torque": TORQUE[twice]}
    said = message(tmp_path, TIME[twice], **columns)
    assert "set clock.drop_duplicates = true" in said
    table = read(tmp_path, rounded, 'unit = "s"\ndrop_duplicates = true')
    assert [fault.name for fault in table.faults] == ["coarse clock"]


def test_a_known_step_replaces_stamps_without_digits(tmp_path):
    table = read(tmp_path, np.full(60, NOW, np.float64) + np.round(TIME), 'unit = "s"\nnominal_step = 0.005')
    np.testing.assert_allclose(table.columns["time"], TIME, atol=1e-12)
    assert any("samples are counted, 5 ms apart" in note for note in table.notes)
    back = NOW + TIME.copy()
    back[40:] -= 1.0
    assert "runs back" in message(tmp_path, back, 'unit = "s"\nnominal_step = 0.005')


EPOCH = 1_709_298_634_000_000_000
NANOSECONDS = EPOCH + np.round(1e9 * TIME).astype(np.int64)


@pytest.mark.parametrize(
    "stamps",
    [
        pa.array(NANOSECONDS, pa.timestamp("ns")),
        pa.array(NANOSECONDS // 1000, pa.timestamp("us", tz="Europe/Berlin")),
        pa.array(NANOSECONDS // 1000_000, pa.timestamp("ms", tz="UTC")),
        pa.array(NANOSECONDS - EPOCH, pa.duration("ns")),
        pa.array((NANOSECONDS - EPOCH) // 1000, pa.duration("us")),
        pa.array((NANOSECONDS - EPOCH) // 1000, pa.time64("us")),
        pa.array([datetime.datetime.fromtimestamp(n / 1e9, datetime.UTC).isoformat(" ") for n in NANOSECONDS]),
    ],
    ids=lambda stamps: str(stamps.type),
)
@pytest.mark.parametrize("clock", ["", 'unit = "ms"'])
def test_the_type_of_a_clock_gives_its_unit_and_its_zero(tmp_path, stamps, clock):
    table = read(tmp_path, stamps, clock)
    np.testing.assert_allclose(table.columns["time"], TIME, atol=1e-12)
    assert any("is not needed" in note for note in table.notes) == bool(clock)
    # Canonical names need no map.
    np.testing.assert_allclose(read_recording(tmp_path / "log.parquet").columns["time"], TIME, atol=1e-12)
    proposal = propose(tmp_path / "log.parquet")
    assert proposal.clock[:2] == ("time", None)
    (tmp_path / "proposed.toml").write_text(to_map(proposal, tmp_path / "log.parquet"))
    again = read_recording(tmp_path / "log.parquet", tmp_path / "proposed.toml")
    np.testing.assert_allclose(again.columns["time"], TIME, atol=1e-12)


@pytest.mark.failure
def test_plain_numbers_need_a_unit_and_dates_need_a_value_in_every_row(tmp_path):
    said = message(tmp_path, TIME, "")
    assert "clock.unit: is missing, and 'time' holds plain numbers" in said
    assert "'us'" in said
    stamps = pa.array([None, *NANOSECONDS[1:].tolist()], pa.timestamp("ns"))
    assert "row 1: column 'time' has no value where a date or time" in message(tmp_path, stamps, "")
    said = message(tmp_path, pa.array(NANOSECONDS, pa.timestamp("ns")), 'not_before = "soon"')
    assert "no date in ISO 8601" in said


def test_a_clock_of_dates_that_was_set_offers_a_date(tmp_path):
    stamps = NANOSECONDS.copy()
    stamps[:5] -= EPOCH
    dates = pa.array(stamps, pa.timestamp("ns"))
    (fault,) = read(tmp_path, dates, "").faults
    assert 'clock.not_before = "2024-03-01 13:10:34.025000000"' in fault.fix
    since = fault.fix.partition("clock.not_before = ")[2].strip()
    assert read(tmp_path, dates, f"not_before = {since}").columns["time"].size == 55


def test_seconds_and_nanoseconds_in_two_columns_are_one_clock(tmp_path):
    """What `ros2 topic echo --csv` writes: no header, and a stamp in two columns."""
    rows = zip(NANOSECONDS // 10**9, NANOSECONDS % 10**9, DEFLECTION, TORQUE, strict=True)
    path = tmp_path / "echo.csv"
    path.write_text("".join(f"{s},{n},base_link,elbow,{float(a)!r},{float(t)!r}\n" for s, n, a, t in rows))
    columns = '["sec", "nanosec", "frame", "joint", "deflection", "elastic_torque"]'
    clock = f'nanoseconds = "nanosec"\n[file]\ncolumns = {columns}'
    (tmp_path / "map.toml").write_text(MAP.format(clock=clock).replace('"time"', '"sec"'))
    table = read_recording(path, tmp_path / "map.toml")
    np.testing.assert_allclose(table.columns["time"], TIME, atol=1e-12)
    np.testing.assert_array_equal(table.columns["deflection"], DEFLECTION)
    proposal = propose(path)
    assert (proposal.clock[0], proposal.nanoseconds) == ("column1", "column2")
    text = to_map(proposal, path)
    assert 'nanoseconds = "column2"' in text
    assert "columns = [" in text


@pytest.mark.parametrize(
    ("name", "step", "unit"),
    [
        ("ans", 0.005, "s"),
        ("columns", 0.005, "s"),
        ("trans_time", 5.0, "ms"),
        ("bus_time", 0.005, "s"),
        ("items_stamp", 5000.0, "us"),
        ("time_ns", 0.005, "s"),
        ("time_ns", 5e6, "ns"),
        ("timeMs", 5.0, "ms"),
        ("t_us", 5000.0, "us"),
        ("stamp [ms]", 5.0, "ms"),
        ("time_millis", 5.0, "ms"),
    ],
)
def test_a_unit_in_a_name_is_a_word_and_makes_a_plausible_step(tmp_path, name, step, unit):
    columns = {name: step * np.arange(60), "deflection": DEFLECTION, "torque": TORQUE}
    pa.parquet.write_table(pa.table(columns), tmp_path / "log.parquet")
    column, found, reason = propose(tmp_path / "log.parquet").clock
    assert (column, found) == (name, unit)
    assert "contradict" in reason or name != "time_ns" or unit == "ns"


@pytest.mark.failure
def test_a_clock_that_stands_is_named_and_days_between_samples_are_no_clock_that_was_set(tmp_path):
    columns = {"deflection": DEFLECTION, "torque": TORQUE}
    pa.parquet.write_table(pa.table({"time_s": np.full(60, 1.7e9), **columns}), tmp_path / "log.parquet")
    with pytest.raises(InputError, match=r"'time_s' is 1700000000\.0 in every sample(?s:.*)clock\.nominal_step"):
        propose(tmp_path / "log.parquet")
    table = read(tmp_path, pa.array(range(60), pa.date32()), "")
    assert not any(fault.name == "clock set" for fault in table.faults)
    assert any("is long for a joint" in note for note in table.notes)


def test_a_matrix_that_simulink_calls_ans_has_a_clock_in_seconds(tmp_path):
    savemat(tmp_path / "log.mat", {"ans": np.stack([TIME, DEFLECTION, TORQUE])})
    assert propose(tmp_path / "log.mat").clock[:2] == ("ans(1,:)", "s")


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("torque_amplitude", "N.m"),
        ("torque_mNm", "mN.m"),
        ("torqueNm", "N.m"),
        ("torque_voltage", "V"),
        ("torque_mA", "mA"),
        ("degraded_link_pos", "rad"),
        ("link_pos_raw_estimate", "rad"),
        ("linkPosDeg", "deg"),
        ("link_pos_turnstile", "rad"),
    ],
)
def test_units_of_signals_are_words_of_their_names(tmp_path, name, unit):
    columns = {"timeout": np.full(60, 3.0), "time": TIME, name: DEFLECTION}
    pa.parquet.write_table(pa.table(columns), tmp_path / "log.parquet")
    proposal = propose(tmp_path / "log.parquet")
    assert proposal.clock[0] == "time"
    assert [guess.unit for guess in proposal.guesses] == [unit]


def test_what_is_counted_is_whole_whatever_the_name_says(tmp_path):
    columns = {"time": TIME, "joint_enc": DEFLECTION, "motor_counts": np.arange(60.0), "torque": TORQUE}
    pa.parquet.write_table(pa.table(columns | {"motor_pos_counts": np.arange(60)}), tmp_path / "log.parquet")
    units = {guess.column: guess.unit for guess in propose(tmp_path / "log.parquet").guesses}
    assert units["joint_enc"] == "rad"
    assert units["motor_pos_counts"] == "counts"


@pytest.mark.failure
@pytest.mark.skipif(not CASES.is_dir(), reason="the cases found by use lie outside the repository")
def test_the_stamps_without_digits_found_by_use_say_so(tmp_path):
    path = CASES / "04e_epoch_float_1e9_g.csv"
    text = to_map(propose(path), path)
    (tmp_path / "map.toml").write_text(text)
    with pytest.raises(InputError, match=r"1989 of 2000 (?s:.*)lost their digits(?s:.*)clock\.nominal_step"):
        read_recording(path, tmp_path / "map.toml")
    (tmp_path / "map.toml").write_text(text.replace('unit = "s"', 'unit = "s"\nnominal_step = 0.005'))
    table = read_recording(path, tmp_path / "map.toml")
    turned = table.columns["link_position"] - table.columns["motor_position"]
    assert np.polyfit(turned, table.columns["elastic_torque"], 1)[0] == pytest.approx(120.0, rel=0.01)
    assert propose(CASES / "09g_tofile.mat").clock[1] == "s"
