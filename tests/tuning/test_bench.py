"""The bench: C computes what we compute, and its verdicts follow from what was measured. No timing is judged."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tuning.bench import measure, opponent, record
from tuning.bench.kernels import KERNELS
from tuning.bench.measure import Row, measure_kernel
from tuning.bench.workload import AGREEMENT, Kernel, Workload
from tuning.errors import InputError

TWINS = ["awas_plant", "antagonistic_plant", "serial_estimator", "sweep", "algebraic_observer"]
SMALL = {
    "awas_plant": (3, ["clock.duration=0.2"]),
    "antagonistic_plant": (3, ["clock.duration=0.2"]),
    "serial_estimator": (3, ["clock.duration=0.1"]),
    "sweep": (2 * 256, ["clock.duration=0.05"]),
    "algebraic_observer": (3, ["clock.duration=1.3"]),
}
ROW = Row("k", "K", 1, 1, 0.1, 1.0, 2.0, None, 0.5, 0.6, True, 0.0, 0, None, "", "")


@pytest.fixture(scope="module")
def c() -> opponent.Opponent:
    if shutil.which("gcc") is None:
        pytest.skip("needs gcc, which this machine does not have")
    return opponent.load_opponent()


@pytest.mark.oracle
@pytest.mark.parametrize("name", TWINS)
def test_c_computes_what_we_compute(name, c):
    lanes, settings = SMALL[name]
    work = KERNELS[name].prepare(lanes, settings)
    assert work.twin is not None
    theirs = work.twin(c)
    assert np.ptp(theirs) > 0.0
    assert work.difference(work.program(*work.arguments), theirs) <= AGREEMENT


@pytest.mark.oracle
def test_c_does_not_depend_on_the_number_of_threads(c):
    work = KERNELS["awas_plant"].prepare(5, ["clock.duration=0.05"])
    assert work.twin is not None
    np.testing.assert_array_equal(work.twin(c), work.twin(replace(c, threads=3)))


@pytest.mark.contract
def test_every_kernel_of_c_has_a_limit_and_a_test():
    assert [name for name, kernel in KERNELS.items() if kernel.limit is None] == ["serial_all_scores"]
    assert set(TWINS) == KERNELS.keys() - {"serial_all_scores", "gradient"}
    assert all(kernel.counting for kernel in KERNELS.values())


def shifted(by: float) -> Kernel:
    """Return the AwAS kernel with a twin that is wrong by a share."""
    true = KERNELS["awas_plant"]

    def prepare(lanes, settings) -> Workload:
        work = true.prepare(lanes, settings)
        assert work.twin is not None
        twin = work.twin
        return replace(work, twin=lambda c: (1.0 + by) * twin(c))

    return replace(true, prepare=prepare, limit=1e9)


@pytest.mark.contract
def test_what_disagrees_is_not_timed_against_c_and_says_so(c, monkeypatch):
    monkeypatch.setattr(measure, "COMPILE_LIMIT", 1e9)
    settings = ["clock.duration=0.05"]
    bad = measure_kernel(shifted(1e-8), c, repeats=1, lanes=2, settings=settings)
    assert (bad.ok, bad.ratio, bad.c_ns_per_step) == (False, None, None)
    assert bad.note.startswith("results differ from C's by 1e-08, more than 1e-09")
    good = measure_kernel(shifted(0.0), c, repeats=2, lanes=2, settings=settings, peak=1.0)
    assert (good.ok, good.note) == (True, "")
    assert good.ratio is not None
    assert good.ratio > 0.0
    assert good.peak_share == pytest.approx((33.0 + 4 * 70.0) / good.ns_per_step)


@pytest.mark.cli
def test_the_command_prints_rows_for_machines(vsajax, monkeypatch):
    for name in ("awas_plant", "antagonistic_plant"):
        monkeypatch.setitem(KERNELS, name, _quick(KERNELS[name]))
    ended = vsajax("bench", "--only", "awas_plant", "--repeats", 1, "--json")
    found = json.loads(ended.out)
    (row,) = found["rows"]
    assert ended.err == ""
    assert ended.code == (0 if found["ok"] else 1)
    assert {"kernel", "lanes", "compile_s", "ns_per_step", "c_ns_per_step", "ratio", "limit", "ok"} <= row.keys()
    assert (row["kernel"], row["lanes"], row["ratio"], row["c_ns_per_step"]) == ("awas_plant", 2, None, None)
    assert row["ok"] == found["ok"]


def _quick(kernel: Kernel) -> Kernel:
    return replace(kernel, prepare=lambda lanes, settings: kernel.prepare(2, ["clock.duration=0.05"]))


@pytest.mark.failure
def test_an_unknown_kernel_is_refused(vsajax):
    ended = vsajax("bench", "--only", "teleport")
    assert (ended.code, ended.out) == (2, "")
    assert ended.err.startswith("error: --only: got teleport\n    fix: allowed: awas_plant")


@pytest.mark.failure
def test_without_a_compiler_the_comparison_says_what_to_do(vsajax, monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    ended = vsajax("bench", "--against", "c")
    assert (ended.code, ended.out) == (2, "")
    assert "no C compiler was found (looked for CC=no-such-compiler)" in ended.err
    assert "fix: install gcc" in ended.err


@pytest.mark.failure
def test_a_source_that_does_not_compile_is_the_users_to_see(c, tmp_path, monkeypatch):
    monkeypatch.setenv("VSAJAX_CACHE", str(tmp_path))
    source = tmp_path / "broken.c"
    source.write_text("int main(void) { return nothing; }", encoding="utf-8")
    with pytest.raises(InputError, match="nothing"):
        opponent.compile_opponent(source)
    assert not list(tmp_path.rglob("*.so"))


@pytest.mark.contract
def test_the_opponent_is_compiled_once(c, tmp_path, monkeypatch):
    monkeypatch.setenv("VSAJAX_CACHE", str(tmp_path))
    first = opponent.compile_opponent()
    stamp = first.stat().st_mtime_ns
    assert opponent.compile_opponent() == first
    assert first.stat().st_mtime_ns == stamp


@pytest.mark.contract
@pytest.mark.parametrize(("ratio", "ok"), [(0.4, True), (0.5, True), (0.51, False), (None, False)])
def test_a_ratio_may_be_a_quarter_worse_than_recorded(ratio, ok):
    (compared,) = record.compare_with({"k": 0.4}, [replace(ROW, ratio=ratio)])
    assert (compared.ok, compared.allowed) == (ok, pytest.approx(0.5))


@pytest.mark.contract
def test_a_record_is_read_back_and_keeps_other_kernels(tmp_path: Path):
    path = tmp_path / "record.json"
    record.write_record([ROW], path)
    record.write_record(
        [replace(ROW, kernel="other", ratio=0.25), replace(ROW, kernel="mine", c_ns_per_step=None)], path
    )
    assert record.read_record(path) == {"k": 0.5, "other": 0.25}


@pytest.mark.failure
@pytest.mark.parametrize(
    ("text", "said"), [(None, "no such record"), ("{}", "not a record"), ("[", "not a record")]
)
def test_a_missing_or_foreign_record_is_refused(text, said, tmp_path: Path):
    path = tmp_path / "record.json"
    if text is not None:
        path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=said):
        record.read_record(path)


@pytest.mark.cli
def test_the_check_fails_for_a_worse_ratio(c, vsajax, tmp_path, monkeypatch):
    path = tmp_path / "record.json"
    monkeypatch.setitem(KERNELS, "awas_plant", _quick(KERNELS["awas_plant"]))
    monkeypatch.setattr(record.read_record, "__defaults__", (path,))
    for recorded, code in ((1e-9, 1), (1e9, 0)):
        path.write_text(json.dumps({"ratios": {"awas_plant": recorded}}), encoding="utf-8")
        ended = vsajax("bench", "--check", "--repeats", 1, "--json")
        assert ended.code == code
        (compared,) = json.loads(ended.out)["check"]
        assert (compared["kernel"], compared["recorded"], compared["ok"]) == ("awas_plant", recorded, code == 0)
