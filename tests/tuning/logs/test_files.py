import os
import stat

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pa_parquet
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tuning.files.errors import InputError
from tuning.files.whole import SUFFIXES, write_table
from tuning.logs.columns import read_log_file


def read_all(path) -> dict[str, np.ndarray]:
    log = read_log_file(path)
    rows = np.arange(log.table.num_rows)
    return {name: log.numbers(name, rows) for name in log.names}


def says(path, *words: str) -> None:
    with pytest.raises(InputError) as caught:
        read_all(path)
    for word in (path.name, *words):
        assert word in str(caught.value)


@pytest.mark.equivalence
@settings(deadline=None)
@given(
    values=st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=30),
    suffix=st.sampled_from(SUFFIXES),
)
def test_what_is_written_is_read_back(tmp_path_factory, values, suffix):
    path = tmp_path_factory.mktemp("written") / f"table{suffix}"
    write_table(path, {"first": np.array(values), "second": -np.array(values)})
    back = read_all(path)
    assert list(back) == ["first", "second"]
    np.testing.assert_array_equal(back["first"].astype(np.float64), values)
    np.testing.assert_array_equal(back["second"].astype(np.float64), -np.array(values))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_writing_makes_the_folder_and_leaves_no_scraps(tmp_path, suffix):
    path = tmp_path / "new" / "deeper" / f"table{suffix}"
    write_table(path, {"a": np.zeros(3), "known": np.array([True, False, True])})
    write_table(path, {"a": np.ones(4)})
    assert os.listdir(path.parent) == [path.name]
    np.testing.assert_array_equal(read_all(path)["a"], np.ones(4))


def test_a_written_file_can_be_read_by_whom_the_umask_allows(tmp_path):
    path = tmp_path / "table.csv"
    write_table(path, {"a": np.zeros(1)})
    umask = os.umask(0)
    os.umask(umask)
    assert stat.S_IMODE(path.stat().st_mode) == 0o666 & ~umask


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_failed_write_leaves_the_old_file_and_no_scraps(tmp_path, suffix, monkeypatch):
    path = tmp_path / f"table{suffix}"
    write_table(path, {"a": np.zeros(3)})
    before = path.read_bytes()

    def refuse(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", refuse)
    with pytest.raises(InputError, match=r"cannot be written.*No space left"):
        write_table(path, {"a": np.ones(3)})
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == [path.name]


@pytest.mark.failure
def test_a_place_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(InputError, match=r"table\.xlsx: unknown suffix '\.xlsx'; known are \.csv, \.parquet"):
        write_table(tmp_path / "table.xlsx", {"a": np.zeros(1)})
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        write_table(tmp_path / "file" / "table.csv", {"a": np.zeros(1)})
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(InputError, match=r"folder\.csv: cannot be written"):
        write_table(tmp_path / "folder.csv", {"a": np.zeros(1)})
    assert sorted(os.listdir(tmp_path)) == ["file", "folder.csv"]


def test_a_byte_order_mark_blanks_and_windows_line_ends_do_not_disturb(tmp_path):
    path = tmp_path / "log.CSV"
    path.write_bytes(b"\xef\xbb\xbf time, torque \r\n0, 1.5 \r\n1,2\r\n\r\n")
    back = read_all(path)
    np.testing.assert_array_equal(back["time"], [0, 1])
    np.testing.assert_array_equal(back["torque"], [1.5, 2.0])


def test_columns_that_are_numbers_in_any_parquet_type_are_read(tmp_path):
    path = tmp_path / "log.parquet"
    columns = {
        "uint": pa.array([1, 2], pa.uint64()),
        "single": pa.array([1, 2], pa.float32()),
        "decimal": pa.array([1, 2], pa.decimal128(10, 2)),
        "text": pa.array(["1", "2e0"]),
        "dictionary": pa.array(["1", "2"]).dictionary_encode(),
    }
    pa_parquet.write_table(pa.table(columns), path)
    for name, values in read_all(path).items():
        np.testing.assert_array_equal(values, [1, 2], err_msg=name)


@pytest.mark.failure
@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", ["is empty (0 bytes)"]),
        ("\n\n", ["has no samples", "header row"]),
        ("a,b\n", ["header but no samples"]),
        ("a,b", ["header but no samples"]),
        ("a,b\n1,2\n\n3\n", ["line 4", "has 1 cells where the header has 2", "separated by commas"]),
        ("a;b\n1;5\n1;2;3\n", ["line 3", "separated by semicolons"]),
        ("a,b\n0,5,0,25\n1,5,0,75\n", ["4 cells", "commas for decimal marks and between", "semicolons"]),
        ("a;b\n1,234;5\n", ["'1,234'", "may be 1.234 or 1234", "decimal ="]),
        ('a,b\n"1,000",5\n"1,005",6\n', ["may be 1.005 or 1005"]),
        ("a,b\n1_0,5\n1,5\n", ["line 2", "'1_0' where a number is needed"]),
        ("a,b\n1,5\n1,\u0661\u0662\n1,6\n", ["line 3", "'\u0661\u0662' where a number"]),
        ("a,b\n1,5\n1,0x1F\n1,6\n", ["line 3", "'0x1F' where a number"]),
        ('a,b\n1,5\n1,"6\n1,7\n', ["line 3", "nothing closes"]),
        ("a,b\n1,2\n1,2,3\n1\n", ["line 3", "has 3 cells", "line 4", "has 1 cells"]),
        ("a,b\n" + "1\n" * 9, ["line 6", "9 lines in all are ragged"]),
        ("a,b\n1,2\n1,2\n1,off\n", ["line 4", "column 'b' has 'off' where a number is needed"]),
        ("a,b\nfoo,bar\n1,2\n", ["line 2", "column 'a' has 'foo'", "units = true", "header = 2"]),
        ("a,b\n1,x\n\n1,y\n", ["line 2", "column 'b' has 'x'", "2 such rows in all", "mend"]),
        (
            "a,b\n1,2\n\n1,\n1,\n",
            ["line 4", "column 'b' has no value or NaN", "finite", "2 such rows in all"],
        ),
        ("a,b\n1,2\n1,nan\n", ["line 3", "column 'b' has no value or NaN"]),
        ("a,b\n1,-inf\n1,2\n", ["line 2", "column 'b' has -inf where a finite number is needed"]),
        ("a,b\n,1\n,1\n", ["line 2", "column 'a' has no value"]),
        ("a,b\ntrue,1\n", ["column 'a' holds bool", "not numbers"]),
    ],
)
def test_a_bad_csv_is_named_by_line(tmp_path, content, words):
    path = tmp_path / "log.csv"
    path.write_text(content)
    says(path, *words)


@pytest.mark.failure
def test_a_quotation_mark_inside_a_cell_is_named_by_line(tmp_path):
    # The next mark, lines below, closes it for whoever counts marks. Where a cell begins with that one, the reader
    # takes the lines between for rows of their own, or those that follow for a part of the cell.
    rows = [f"{0.01 * i:.2f},{0.1 * i:.1f}" for i in range(60)]
    path = tmp_path / "log.csv"
    for opened, last, closed in (('0.01,0."1', 40, '".40,4.0'), ('0.01,0.1"', 2, '0.02,".2')):
        broken = [*rows[:1], opened, *rows[2:last], closed, *rows[last + 1 :]]
        path.write_text("\n".join(["time,x", *broken, ""]))
        says(path, "line 3", "has a quotation mark in a cell that does not end with one", "close them")


@pytest.mark.failure
def test_a_bad_parquet_is_named(tmp_path):
    path = tmp_path / "log.parquet"
    path.write_bytes(b"")
    says(path, "is empty (0 bytes)")
    path.write_text("time,deflection\n0,1\n")
    says(path, "cannot be read as a Parquet file", "misnamed")
    write_table(path, {"a": np.arange(1000.0)})
    path.write_bytes(path.read_bytes()[:-100])
    says(path, "cannot be read as a Parquet file", "cut short")
    write_table(path, {"a": np.zeros(0)})
    says(path, "header but no samples")
    pa_parquet.write_table(pa.table({"a": pa.array([1.0, None]), "b": [[1], [2]]}), path)
    says(path, "row 2", "column 'a' has no value")


@pytest.mark.failure
def test_a_file_that_is_not_there_is_named(tmp_path):
    (tmp_path / "elbow.csv").write_text("a\n1\n")
    says(tmp_path / "elbwo.csv", "no such file", "did you mean", "elbow.csv")
    says(tmp_path / "nowhere" / "log.csv", "no such file", "check the path")
    says(tmp_path / "log.mat", "unknown suffix '.mat'", ".csv, .tsv, .txt")
    (tmp_path / "folder.csv").mkdir()
    says(tmp_path / "folder.csv", "is a directory", "name a file in it")
    says(tmp_path, "is a directory")
