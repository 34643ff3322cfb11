"""Text as loggers, spreadsheets and people write it: read the same whatever its marks, and said; else refused."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from tuning.files.errors import InputError, printable
from tuning.logs.columns import read_log_file
from tuning.logs.guess import propose, to_map
from tuning.logs.layout import FileFormat
from tuning.logs.reading import read_recording, read_series

CASES = Path(__file__).parents[4] / "shared" / "cases" / "logs"

TIME = 0.005 * np.arange(40)
DEFLECTION = np.round(0.02 * np.sin(40.0 * TIME), 6)
TORQUE = np.round(120.0 * DEFLECTION, 6)
NAMES = ("time_s", "deflection_rad", "torque_Nm")

MAP = """
schema_version = 1
kind = "sea"
{file}
[clock]
column = "{time}"
unit = "s"
[signals.deflection]
column = "{deflection}"
unit = "rad"
[signals.elastic_torque]
column = "{torque}"
unit = "N.m"
"""


def rows(separator: str = ",", *, comma: bool = False) -> list[str]:
    lines = [separator.join(f"{x:.6f}" for x in row) for row in zip(TIME, DEFLECTION, TORQUE, strict=True)]
    return [line.replace(".", ",") for line in lines] if comma else lines


def text(separator: str = ",", *, comma: bool = False, head: tuple[str, ...] | None = None) -> str:
    head = (separator.join(NAMES),) if head is None else head
    return "\n".join([*head, *rows(separator, comma=comma)]) + "\n"


def quoted(line: str) -> str:
    return ",".join(f'"{cell.replace(".", ",")}"' for cell in line.split(","))


def read(path: Path, names=NAMES, file: str = "", **given: str):
    keys = dict(zip(("time", "deflection", "torque"), names, strict=True)) | given
    signal_map = path.with_suffix(".toml")
    signal_map.write_text(MAP.format(file=file and f"[file]\n{file}", **keys))
    return read_recording(path, signal_map)


def holds(table) -> None:
    np.testing.assert_allclose(table.columns["time"], TIME, atol=1e-12)
    np.testing.assert_allclose(table.columns["deflection"], DEFLECTION, rtol=1e-15)
    np.testing.assert_allclose(table.columns["elastic_torque"], TORQUE, rtol=1e-15)


BLANKS = "   ".join(NAMES)
READ = {
    "semicolons, decimal commas": (text(";", comma=True).encode(), ["file.separator", "file.decimal"]),
    "tabs": (text("\t").encode(), ["tabs between"]),
    "tabs, decimal commas": (text("\t", comma=True).encode(), ["tabs between", "decimal comma"]),
    "bars": (text("|").encode(), ["bars between"]),
    "blanks": (("  " + text("  ", head=(BLANKS,)).replace("\n", "\n  ")).encode(), ["blanks between"]),
    "blanks, decimal commas": (
        text(" ", comma=True, head=(BLANKS,)).encode(),
        ["blanks between", "decimal comma"],
    ),
    "quoted decimal commas": (
        "\n".join([",".join(NAMES), *map(quoted, rows())]).encode(),
        ["decimal comma (file.decimal)"],
    ),
    "what Excel says of its separator": (("sep=;\n" + text(";", comma=True)).encode(), ["decimal comma"]),
    "UTF-8 with a mark": (text().encode("utf-8-sig"), []),
    "UTF-16 with a mark": (text().encode("utf-16"), ["utf-16 (file.encoding)"]),
    "UTF-16 without one": (text().encode("utf-16-be"), ["utf-16-be (file.encoding)"]),
    "Windows line ends, trailing separators": (text().replace("\n", ",\r\n").encode(), []),
    "a units row": (text(head=(",".join(NAMES), "s,rad,Nm")).encode(), ["line 2 holds units: s, rad, Nm"]),
    "units in brackets": (text(head=(",".join(NAMES), "[s],[rad],[N·m]")).encode(), ["line 2 holds units"]),
    "comments first": (("# robot 7\n# 2024\n" + text()).encode(), ["comments left out: line 1 and 1 more"]),
    "names in a comment": (text(" ", head=("# " + BLANKS,)).encode(), ["names of the columns from the comment"]),
    "a preamble": (text(head=("Logger 2.1", "Robot: 7", "", ",".join(NAMES))).encode(), ["lines 1 to 2 before"]),
    "a header again": (
        "\n".join([",".join(NAMES), *rows()[:20], ",".join(NAMES), *rows()[20:]]).encode(),
        ["header comes again on line 22"],
    ),
    "a last line cut off": ((text() + "0.2,0.0").encode(), ["line 42, the last, is cut off"]),
    "a file padded with zeros": (text().encode() + bytes(4096), []),
}


@pytest.mark.equivalence
@pytest.mark.parametrize("layout", READ)
def test_however_it_is_written_it_is_read_and_said_and_the_map_proposed_says_it(tmp_path, layout):
    raw, words = READ[layout]
    path = tmp_path / "log.csv"
    path.write_bytes(raw)
    table = read(path)
    holds(table)
    for word in words:
        assert any(word in note for note in table.notes), table.notes
    proposed = to_map(propose(path), path)
    (tmp_path / "proposed.toml").write_text(proposed)
    again = read_recording(path, tmp_path / "proposed.toml")
    holds(again)
    # What the map says is not said again as found.
    assert not any("file.separator" in note or "file.decimal" in note for note in again.notes)


def test_digits_in_groups_are_numbers_where_nothing_else_is_possible(tmp_path):
    for mark, cell in ((",", '"{:,}"'), ("'", "{:,}"), (" ", "{:,}")):
        path = tmp_path / "log.csv"
        stamps = [cell.format(round(1e6 * t)).replace(",", mark) for t in TIME]
        lines = [f"{stamp},{row.split(',', 1)[1]}" for stamp, row in zip(stamps, rows(), strict=True)]
        path.write_text("\n".join(["time_us,deflection_rad,torque_Nm", *lines]))
        proposal = propose(path)
        assert proposal.file["thousands"] == mark
        (tmp_path / "map.toml").write_text(to_map(proposal, path))
        holds(read_recording(path, tmp_path / "map.toml"))


@pytest.mark.parametrize(
    "date",
    [
        "2024-03-01 13:10:{:09.6f}",
        "2024-03-01T13:10:{:09.6f}Z",
        "2024-03-01T13:10:{:06.3f}+01:00",
        "13:10:{:09.6f}",
        "9:10:{:06.3f}",
        "9:10:{:06.3f} PM",
        "10:{:04.3f}",
        "01.03.2024 13:10:{:06.3f}",
        "3/1/2024, 1:10:{:06.3f} PM",
    ],
)
@pytest.mark.parametrize("mark", [".", ","])
def test_dates_are_a_clock_with_a_unit_and_a_zero(tmp_path, date, mark):
    stamps = [f'"{mark.join(date.format(34.0 + t).rsplit(".", 1))}"' for t in TIME]
    lines = [f"{stamp},{row.split(',', 1)[1]}" for stamp, row in zip(stamps, rows(), strict=True)]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["timestamp,deflection_rad,torque_Nm", *lines]))
    proposal = propose(path)
    assert proposal.clock[:2] == ("timestamp", None)
    (tmp_path / "map.toml").write_text(to_map(proposal, path))
    table = read_recording(path, tmp_path / "map.toml")
    holds(table)
    assert any("time starts at zero where 'timestamp' is" in note for note in table.notes)
    # A unit in the map is not needed, and does no harm.
    noted = read(path, ("timestamp", *NAMES[1:]))
    holds(noted)
    assert any("clock.unit 's' is not needed" in note for note in noted.notes)


@pytest.mark.parametrize(("day", "hours"), [("{}", (23, 0)), ("{} PM", (11, 12))])
def test_times_of_day_run_on_over_midnight(tmp_path, day, hours):
    path = tmp_path / "log.csv"
    late, early = (
        day.format(f"{hour}:{rest}") for hour, rest in zip(hours, ("59:59.900", "00:00.100"), strict=True)
    )
    early = early.replace("PM", "AM")
    path.write_text(f"time,deflection,elastic_torque\n{late},0,0\n{early},1,1\n{early.replace('.1', '.3')},1,1\n")
    np.testing.assert_allclose(read_recording(path).columns["time"], [0.0, 0.2, 0.4], atol=1e-9)


def test_days_of_spreadsheets_and_of_matlab_are_a_unit(tmp_path):
    path = tmp_path / "log.csv"
    for zero in (45352.55, 739312.55):
        stamps = [f"{zero + t / 86400.0:.13f}" for t in TIME]
        lines = [f"{stamp},{row.split(',', 1)[1]}" for stamp, row in zip(stamps, rows(), strict=True)]
        path.write_text("\n".join(["time,deflection_rad,torque_Nm", *lines]))
        proposal = propose(path)
        assert proposal.clock[1] == "d"
        (tmp_path / "map.toml").write_text(to_map(proposal, path))
        table = read_recording(path, tmp_path / "map.toml")
        # A double of that many days resolves 10 µs.
        np.testing.assert_allclose(table.columns["time"], TIME, atol=2e-5)


@pytest.mark.parametrize("suffix", [".tsv", ".txt", ".dat", ".asc"])
def test_text_by_other_names_is_read_too(tmp_path, suffix):
    path = tmp_path / f"log{suffix}"
    path.write_text(text("\t") if suffix == ".tsv" else text(" ", head=(BLANKS,)))
    holds(read(path))


def test_a_file_without_a_header_takes_its_names_from_the_map(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("\n".join(rows()))
    assert read_log_file(path).names == ("column1", "column2", "column3")
    assert "no header" in read_log_file(path).notes[0]
    table = read(path, file='columns = ["time_s", "deflection_rad", "torque_Nm"]')
    holds(table)
    assert not any("header" in note for note in table.notes)


def test_what_the_map_says_of_the_file_holds(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["// x", "a;b;c", *NAMES[:1], ";".join(NAMES), "x;y;z", *rows(";")]))
    holds(read(path, file='header = 4\nunits = true\nseparator = ";"\ndecimal = "."'))
    # 1.234 is a thousand and more where the map says so.
    path.write_text("a;b\n1.234;5\n2.000;6\n")
    told = read_log_file(path, FileFormat(decimal=",", thousands="."))
    np.testing.assert_array_equal(told.numbers("a", np.arange(2)), [1234, 2000])
    np.testing.assert_array_equal(read_log_file(path).numbers("a", np.arange(2)), [1.234, 2.0])


@pytest.mark.failure
@pytest.mark.parametrize(
    ("file", "words"),
    [
        ('separator = "x"', ["file.separator"]),
        ('decimal = ","\nthousands = ","', ["decimal and thousands are both"]),
        ('encoding = "klingon"', ["file.encoding", "'klingon'"]),
        ('columns = ["a", "a"]', ["a name twice"]),
        ("header = 99", ["line 99", "file.header"]),
        ('seperator = ","', ["file.seperator", "separator?"]),
        ('encoding = "ascii"', ["is not ascii text"]),
    ],
)
def test_what_the_map_says_wrongly_of_the_file_is_named(tmp_path, file, words):
    path = tmp_path / "log.csv"
    path.write_text(text(head=("time_s,deflection_rad,torque_Nm µ",)))
    with pytest.raises(InputError) as caught:
        read(path, file=file)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.failure
def test_a_line_of_units_other_than_the_maps_is_noted_and_canonical_columns_must_be_in_si(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(text(head=(",".join(NAMES), "s,deg,Nm")))
    assert any("deflection is read in rad, as the map says" in note for note in read(path).notes)
    path.write_text(text(head=("time,deflection,elastic_torque", "ms,deg,Nm")))
    with pytest.raises(InputError, match=r"(?s)time: is in 'ms' .* deflection: is in 'deg' by the line of units"):
        read_recording(path)
    path.write_text(text(head=("time,deflection,elastic_torque", "s,rad,N.m")))
    holds(read_recording(path))


@pytest.mark.failure
@pytest.mark.parametrize(
    ("raw", "words"),
    [
        (b"PK\x03\x04rest", "Excel workbook"),
        (b"a,b\n1,2\n\x00\x00\x00\n3,4\n", "line 3: holds NUL"),
        ("a,b\n1,2\n3,ß\n".encode("latin-1"), "line 3: column 'b' has 'ß'"),
    ],
)
def test_what_is_no_text_is_named(tmp_path, raw, words):
    path = tmp_path / "log.csv"
    path.write_bytes(raw)

    def look():
        log = read_log_file(path)
        log.numbers("b", np.arange(log.table.num_rows))

    with pytest.raises(InputError, match=words):
        look()


def test_text_that_is_not_utf8_is_read_as_windows_writes_it_and_said(tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes("Auslenkung [°];b\n1,5;2,5\n".encode("cp1252"))
    log = read_log_file(path)
    assert log.names == ("Auslenkung [°]", "b")
    assert "cp1252 (file.encoding)" in log.notes[0]


@pytest.mark.failure
def test_names_that_steer_a_terminal_or_break_lines_are_named_not_sent(tmp_path, vsajax):
    path = tmp_path / "log.csv"
    evil = "spare\n[expect]\nstiffness = [1e9, 2e9] #\x1b[31m\u202e"
    path.write_text('time,deflection,elastic_torque,"' + evil + '"\n' + "".join(f"{r},1\n" for r in rows()))
    assert read_log_file(path).names[3] == evil
    proposed = to_map(propose(path), path)
    assert "expect" not in tomllib.loads(proposed)
    assert printable(evil) in proposed
    assert not set("\x1b\u202e") & set(proposed)
    # The same name as a signal's is read back by the map.
    path.write_text('time,deflection,"torque' + evil + '"\n' + "".join(f"{r}\n" for r in rows()))
    (tmp_path / "map.toml").write_text(to_map(propose(path), path))
    holds(read_recording(path, tmp_path / "map.toml"))
    for arguments in (
        ("estimate", path, "-c", "shipped:tuned/sea_sensor"),
        ("init", "map", path, "-o", tmp_path / "new.toml"),
    ):
        ended = vsajax(*arguments)
        assert not {"\x1b", "\u202e", "\x07"} & set(ended.out + ended.err)
    assert r"\x1b[31m" in ended.out


@pytest.mark.failure
def test_where_nothing_can_be_said_nothing_is_found_out(tmp_path):
    path = tmp_path / "torque.csv"
    path.write_text(text(";", comma=True, head=("time;motor_torque;x",)))
    with pytest.raises(InputError, match=r"torque\.csv: is no plain table: read with semicolons (?s:.*)commas"):
        read_series(path, "motor_torque")
    path.write_text(text(head=("time,motor_torque,x",)))
    np.testing.assert_allclose(read_series(path, "motor_torque")[1], DEFLECTION)


@pytest.mark.skipif(not CASES.is_dir(), reason="the cases found by use lie outside the repository")
@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("02a_unitsrow.csv", "line 2 holds units"),
        ("03a_semi_dec.csv", "decimal comma"),
        ("03d_utf16.csv", "utf-16"),
        ("03k_thousands.csv", "digits grouped by ','"),
        ("04b_iso.csv", "time starts at zero where 'timestamp' is 2024-03-01 13:10:34"),
        ("08f_repeated_header.csv", "line 1002"),
    ],
)
def test_the_cases_found_by_use_are_read(tmp_path, name, words):
    proposal = propose(CASES / name)
    (tmp_path / "map.toml").write_text(to_map(proposal, CASES / name))
    table = read_recording(CASES / name, tmp_path / "map.toml")
    assert any(words in note for note in (*proposal.notes, *table.notes))
    turned = table.columns["link_position"] - table.columns["motor_position"]
    assert table.columns["time"].size == 2000
    assert np.median(np.diff(table.columns["time"])) == pytest.approx(0.005)
    assert np.polyfit(turned, table.columns["elastic_torque"], 1)[0] == pytest.approx(120.0, rel=0.01)
