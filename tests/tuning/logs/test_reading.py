import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tuning.files.errors import InputError
from tuning.files.whole import SUFFIXES
from tuning.logs.reading import read_recording, write_table
from tuning.logs.signal_map import KINDS, signals_of

ROOT = Path(__file__).resolve().parents[3]
MAPS = ROOT / "configs" / "logs"
HEBI = ROOT / "tests" / "golden" / "hebi" / "exampleLog.csv"
TREGEAR = ROOT.parent / "shared" / "data" / "sea_tregear"

needs_tregear = pytest.mark.skipif(
    not TREGEAR.is_dir(), reason=f"the SEA recordings may not be shipped and are not in {TREGEAR}"
)

SEA_MAP = """
schema_version = 1
kind = "sea"
[clock]
column = "stamp"
unit = "ms"
{clock}
{select}
[signals.deflection]
column = "angle"
unit = "deg"
{deflection}
[signals.elastic_torque]
column = "force"
unit = "mN.m"
"""

floats = st.floats(allow_nan=False, allow_infinity=False)


def write_map(folder: Path, *, clock: str = "", select: str = "", deflection: str = "") -> Path:
    path = folder / "map.toml"
    path.write_text(SEA_MAP.format(clock=clock, select=select, deflection=deflection))
    return path


def write_log(folder: Path, *rows: str, header: str = "stamp,angle,force") -> Path:
    path = folder / "log.csv"
    path.write_text("\n".join([header, *rows, ""]))
    return path


def message(*args, **kwargs) -> str:
    with pytest.raises(InputError) as caught:
        read_recording(*args, **kwargs)
    return str(caught.value)


def stiffness_of(recording) -> float:
    """Return the least-squares slope of torque over deflection, with an offset."""
    return np.polyfit(recording.columns["deflection"], recording.columns["elastic_torque"], 1)[0]


@pytest.mark.equivalence
@settings(deadline=None)
@given(data=st.data(), kind=st.sampled_from(KINDS), suffix=st.sampled_from(SUFFIXES))
def test_a_canonical_recording_is_read_back_as_it_was_written(tmp_path_factory, data, kind, suffix):
    time = sorted(data.draw(st.lists(st.floats(-1e9, 1e9), min_size=3, max_size=20, unique=True)))
    column = st.lists(floats, min_size=len(time), max_size=len(time)).map(np.array)
    columns = {"time": np.array(time)} | {name: data.draw(column) for name in signals_of(kind)}
    path = tmp_path_factory.mktemp("recording") / f"log{suffix}"
    write_table(path, columns)
    recording = read_recording(path, kind=kind)
    assert recording.kind == kind
    assert recording.source == str(path)
    assert set(recording.columns) == set(columns)
    for name, values in columns.items():
        assert recording.columns[name].dtype == np.float64
        np.testing.assert_array_equal(recording.columns[name], values)


@pytest.mark.parametrize("kind", KINDS)
def test_the_kind_is_inferred_from_the_columns(tmp_path, kind):
    path = tmp_path / "log.csv"
    write_table(path, {name: np.arange(4.0) for name in ("time", *signals_of(kind))})
    recording = read_recording(path)
    assert recording.kind == kind
    assert f"kind {kind!r} inferred from the columns" in recording.notes


def test_an_unknown_column_of_a_canonical_file_is_ignored_and_noted(tmp_path):
    path = write_log(tmp_path, "0,1,2,x", "1,2,3,", "2,3,4,y", header="time,deflection,elastic_torque,mood")
    recording = read_recording(path)
    assert list(recording.columns) == ["time", "deflection", "elastic_torque"]
    assert "columns ignored, being no signals of kind 'sea': mood" in recording.notes


def test_a_canonical_file_keeps_its_own_zero_of_time(tmp_path):
    path = write_log(tmp_path, "7,1,2", "8,2,3", "9,3,4", header="time,deflection,elastic_torque")
    np.testing.assert_array_equal(read_recording(path).columns["time"], [7.0, 8.0, 9.0])


def test_a_map_brings_a_foreign_log_to_si(tmp_path):
    log = write_log(tmp_path, "1000,180,500", "1002,90,250", "1004,0,0")
    recording = read_recording(log, write_map(tmp_path, deflection="sign = -1\noffset = 90"))
    np.testing.assert_allclose(recording.columns["time"], [0.0, 2e-3, 4e-3], rtol=1e-15)
    np.testing.assert_allclose(recording.columns["deflection"], np.pi * np.array([-0.5, 0.0, 0.5]))
    np.testing.assert_allclose(recording.columns["elastic_torque"], [0.5, 0.25, 0.0])
    assert "time starts at zero where 'stamp' is 1000 ms" in recording.notes
    kept = read_recording(log, write_map(tmp_path, clock="start_at_zero = false"))
    np.testing.assert_allclose(kept.columns["time"], [1.0, 1.002, 1.004])


def test_the_kind_of_the_map_holds(tmp_path):
    log = write_log(tmp_path, "0,1,2", "1,2,3", "2,3,4")
    recording = read_recording(log, write_map(tmp_path), kind="serial")
    assert recording.kind == "sea"
    assert "kind 'sea' of the signal map holds, not 'serial'" in recording.notes


def test_duplicate_stamps_are_dropped_on_request(tmp_path):
    log = write_log(tmp_path, "0,1,2", "0,9,9", "1,2,3", "1,9,9", "1,9,9", "2,3,4")
    recording = read_recording(log, write_map(tmp_path, clock="drop_duplicates = true"))
    np.testing.assert_array_equal(recording.columns["elastic_torque"], [2e-3, 3e-3, 4e-3])
    assert "3 duplicate timestamps dropped (drop_duplicates = true)" in recording.notes


def test_what_is_odd_about_the_clock_is_noted(tmp_path):
    log = write_log(tmp_path, "0,1,2", "1,2,3", "2,3,4", "308,3,4")
    assert (
        "largest gap 306 ms at t = 0.002 s (median time step 1 ms)"
        in read_recording(log, write_map(tmp_path)).notes
    )
    log = write_log(tmp_path, "0,1,2", "2000,2,3", "4000,3,4")
    notes = read_recording(log, write_map(tmp_path)).notes
    assert "median time step 2 s is long for a joint: is clock.unit 'ms' right?" in notes


def test_a_wrapping_encoder_is_unwrapped_and_noted(tmp_path):
    log = write_log(tmp_path, "0,300,0", "1,359,0", "2,60,0", "3,1,0", "4,300,0")
    recording = read_recording(log, write_map(tmp_path, deflection="wraps_at = 360"))
    np.testing.assert_allclose(np.rad2deg(recording.columns["deflection"]), [300, 359, 420, 361, 300])
    assert "deflection unwrapped at 360 deg: 2 wraps" in recording.notes


RUNS = ("0,1,2,a,1", "1,2,3,a,1", "2,3,4,a,1", "0,5,6,b,2", "1,6,7,b,2", "2,7,8,b,2.5")


@pytest.mark.parametrize(
    ("in_map", "override", "first_angle"),
    [
        ('[select]\nrun = "a"', None, 1.0),
        ("[select]\nspring = 1", None, 1.0),
        ('[select]\nrun = "a"', {"run": "b"}, 5.0),
        ("", {"run": "b"}, 5.0),
        ("", {"spring": "1"}, 1.0),
        ('[select]\nrun = "a"', {"spring": 1.0}, 1.0),
    ],
)
def test_one_run_of_many_is_selected(tmp_path, in_map, override, first_angle):
    log = write_log(tmp_path, *RUNS, header="stamp,angle,force,run,spring")
    recording = read_recording(log, write_map(tmp_path, select=in_map), select=override)
    np.testing.assert_allclose(np.rad2deg(recording.columns["deflection"])[0], first_angle)
    assert recording.columns["time"].size == 3
    assert any(note.startswith("3 of 6 rows selected by ") for note in recording.notes)


def test_bad_cells_in_rows_that_are_not_selected_do_not_matter(tmp_path):
    log = write_log(tmp_path, "0,1,x,bad", *[f"{i},1,1,good" for i in range(3)], header="stamp,angle,force,run")
    assert read_recording(log, write_map(tmp_path), select={"run": "good"}).columns["time"].size == 3
    log = write_log(tmp_path, *RUNS, "3,1,x,b,2", header="stamp,angle,force,run,spring")
    assert "line 8" in message(log, write_map(tmp_path), select={"run": "b"})


@pytest.mark.parametrize(("wanted", "is_there"), [(True, True), ("true", True), ("yes", False)])
def test_truth_values_are_selected(tmp_path, wanted, is_there):
    log = write_log(tmp_path, *[f"{i},1,1,true" for i in range(3)], header="stamp,angle,force,on")
    if is_there:
        assert read_recording(log, write_map(tmp_path), select={"on": wanted}).columns["time"].size == 3
    else:
        assert "no row has on = 'yes'" in message(log, write_map(tmp_path), select={"on": wanted})


@pytest.mark.failure
def test_a_selection_of_nothing_says_what_there_is(tmp_path):
    log = write_log(tmp_path, *RUNS, *(f"9,9,9,r{i},3" for i in range(9)), header="stamp,angle,force,run,spring")
    said = message(log, write_map(tmp_path), select={"run": "c"})
    for words in ("log.csv", "no row has run = 'c'", "'a', 'b', 'r0', 'r1', 'r2' and 6 more"):
        assert words in said
    assert "no row has spring = 'soft'" in message(log, write_map(tmp_path), select={"spring": "soft"})
    assert "values there: 'b'" in message(log, write_map(tmp_path), select={"spring": 2, "run": "a"})


@pytest.mark.failure
def test_all_missing_columns_are_named_at_once(tmp_path):
    log = write_log(tmp_path, "0,1,2", header="Stamp,angel,weight")
    said = message(log, write_map(tmp_path), select={"run": "a"})
    for words in (
        "map.toml: clock.column: no column 'stamp' in",
        "did you mean 'Stamp'?",
        "map.toml: signals.deflection.column: no column 'angle'",
        "did you mean 'angel'?",
        "map.toml: signals.elastic_torque.column: no column 'force'",
        "map.toml: select.run: no column 'run'",
        "columns present: Stamp, angel, weight",
    ):
        assert words in said


@pytest.mark.failure
def test_all_columns_a_canonical_file_lacks_are_named_at_once(tmp_path):
    log = write_log(tmp_path, "0,1,2", header="t,setpoint_position,link_positon")
    said = message(log)
    for words in (
        "no column time",
        "no column link_position, needed for kind 'serial'",
        "did you mean 'link_positon'?",
        "no column motor_position",
        "no column motor_torque",
        "columns present: t, setpoint_position, link_positon",
        "signal map",
        "vsajax init logs/hebi",
    ):
        assert words in said
    assert "no column deflection (or link_position and motor_position)" in message(log, kind="sea")
    assert "no column motor2_torque" in message(log, kind="antagonistic")


@pytest.mark.failure
def test_two_columns_of_one_name_are_refused(tmp_path):
    log = write_log(tmp_path, "0,1,2,3", header="stamp,angle,force,angle")
    said = message(log, write_map(tmp_path))
    assert "signals.deflection.column: 2 columns of" in said
    assert "named 'angle'" in said
    log = write_log(tmp_path, "0,1,2,3", header="time,deflection,elastic_torque,deflection")
    assert "2 columns of" in message(log)


@pytest.mark.failure
def test_bad_cells_of_all_columns_are_named_at_once(tmp_path):
    log = write_log(tmp_path, "0,1,2", "x,2,3", "2,,4", "3,4,inf")
    said = message(log, write_map(tmp_path))
    for words in (
        "line 3: column 'stamp' has 'x'",
        "line 4: column 'angle' has no",
        "line 5: column 'force'",
    ):
        assert words in said


@pytest.mark.failure
@pytest.mark.parametrize(
    ("stamps", "words"),
    [
        (
            "0 1 1 2",
            ["line 4", "'stamp' goes from 1 (line 3) to 1", "1 of 4", "clock.drop_duplicates", "clock.unit"],
        ),
        (
            "0 5 2.5 9",
            ["line 4", "goes from 5.0 (line 3) to 2.5", "sort the file", "select one run", "clock.unit"],
        ),
        ("3 2 1 0", ["line 3", "goes from 3 (line 2) to 2", "3 of 4"]),
    ],
)
def test_a_clock_that_does_not_advance_is_named_by_line(tmp_path, stamps, words):
    log = write_log(tmp_path, *(f"{stamp},1,2" for stamp in stamps.split()))
    said = message(log, write_map(tmp_path))
    for word in ("log.csv", "time must strictly increase", *words):
        assert word in said


@pytest.mark.failure
def test_dropping_duplicates_does_not_forgive_a_clock_that_runs_back(tmp_path):
    log = write_log(tmp_path, "0,1,2", "1,2,3", "1,2,3", "0,3,4")
    said = message(log, write_map(tmp_path, clock="drop_duplicates = true"))
    assert "line 5" in said
    assert "from 1 (line 3) to 0" in said


@pytest.mark.failure
def test_a_clock_that_does_not_advance_is_found_in_the_selected_rows_of_the_file(tmp_path):
    log = write_log(tmp_path, *RUNS, "2,7,8,b,2", header="stamp,angle,force,run,spring")
    said = message(log, write_map(tmp_path), select={"run": "b"})
    assert "log.csv: line 8" in said
    assert "goes from 2 (line 7) to 2" in said


@pytest.mark.failure
def test_too_few_samples_are_refused(tmp_path):
    log = write_log(tmp_path, "0,1,2", "1,2,3", "1,2,3")
    assert "2 samples are left; at least 3 are needed" in message(
        log, write_map(tmp_path, clock="drop_duplicates = true")
    )


@pytest.mark.failure
def test_a_wrong_period_is_refused(tmp_path):
    log = write_log(tmp_path, "0,0,0", "1,200,0", "2,359,0")
    said = message(log, write_map(tmp_path, deflection="wraps_at = 6.2832"))
    for words in ("signals.deflection.wraps_at", "spans 359 deg", "wraps_at = 6.2832", "period"):
        assert words in said


@pytest.mark.failure
def test_a_kind_or_file_that_is_not_known_is_named(tmp_path):
    log = write_log(tmp_path, "0,1,2")
    assert "got 'parallel'; allowed are serial, antagonistic, sea" in message(log, kind="parallel")
    assert "no such file" in message(tmp_path / "none.csv")
    assert "nomap.toml: no such file" in message(log, tmp_path / "nomap.toml")


@pytest.mark.structure
def test_reading_a_log_does_not_import_jax():
    code = "import sys, tuning.logs.reading; sys.exit('jax' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0


@pytest.mark.real
def test_the_hebi_log_has_the_stiffness_its_maker_set():
    recording = read_recording(HEBI, MAPS / "hebi.toml")
    assert recording.columns["time"].size == 999
    assert stiffness_of(recording) == pytest.approx(40.0, rel=1e-9)


@pytest.mark.real
def test_the_hebi_encoders_agree_through_the_gear():
    columns = read_recording(HEBI, MAPS / "hebi.toml").columns
    slope = np.polyfit(columns["motor_position"], columns["link_position"], 1)[0]
    assert slope == pytest.approx(1.0, abs=0.01)


@pytest.mark.real
@needs_tregear
@pytest.mark.parametrize(
    ("run", "stiffness"),
    [
        ("kt-1-4-13-2-27022023-171453", 2610.3),
        ("kt-1-5-14-2-27022023-171936", 2615.5),
        ("kt-1-6-15-2-27022023-172030", 2611.7),
        ("kt-2-4-16-2-27022023-172136", 2620.3),
        ("kt-2-5-17-2-27022023-172319", 2622.7),
        ("kt-2-6-18-2-27022023-172422", 2620.7),
    ],
)
def test_the_second_spring_is_as_stiff_as_measured_elsewhere(run, stiffness):
    recording = read_recording(TREGEAR / "runs.parquet", MAPS / "sea_tregear.toml", select={"file": run})
    assert stiffness_of(recording) == pytest.approx(stiffness, abs=0.1)
    assert any(note.startswith("largest gap") for note in recording.notes)


@pytest.mark.real
@needs_tregear
def test_all_runs_at_once_are_refused_where_the_second_begins(tmp_path):
    text = (MAPS / "sea_tregear.toml").read_text()
    (tmp_path / "map.toml").write_text(text.replace("[select]\nfile", "[select]\nspring = 2 #"))
    said = message(TREGEAR / "runs.parquet", tmp_path / "map.toml")
    assert "time must strictly increase" in said
    assert "select one run" in said


@pytest.mark.real
@needs_tregear
def test_both_forms_of_a_run_are_one_recording():
    original = read_recording(TREGEAR / "kt-1-1-1-1.csv", MAPS / "sea_tregear_csv.toml")
    gathered = read_recording(
        TREGEAR / "runs.parquet", MAPS / "sea_tregear.toml", select={"file": "kt-1-1-1-1-27022023-160414"}
    )
    for name, values in gathered.columns.items():
        np.testing.assert_array_equal(original.columns[name], values)
