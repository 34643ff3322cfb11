"""The bench: C computes what we compute, and its verdicts follow from what was measured. No timing is judged."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest

from tuning.bench import damping, measure, opponent, record
from tuning.bench.kernels import KERNELS
from tuning.bench.measure import Row, measure_kernel
from tuning.bench.workload import AGREEMENT, Kernel, Workload
from tuning.files.errors import InputError
from tuning.problem.build import with_leaves
from vsajax.experiments import damping as closed_loop

TWINS = ["awas_plant", "antagonistic_plant", "serial_estimator", "sweep", "algebraic_observer"]
LOOPS = ["damping_loop", "damping_loop_sensed"]
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


def test_the_opponent_leaves_the_processor_as_it_was(c):
    assert c._functions is not None
    assert np.float64(5e-324) * np.float64(1.0) > 0.0


@pytest.mark.oracle
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.slow] if name in {"sweep", "algebraic_observer"} else [])
        for name in TWINS
    ],
)
def test_c_computes_what_we_compute(name, c):
    lanes, settings = SMALL[name]
    work = KERNELS[name].prepare(lanes, settings)
    assert work.twin is not None
    theirs = work.twin(c)
    assert np.ptp(theirs) > 0.0
    assert work.difference(work.program(*work.arguments), theirs) <= AGREEMENT
    np.testing.assert_array_equal(work.twin(replace(c, threads=3)), theirs)


@pytest.mark.contract
def test_every_kernel_of_c_has_a_limit_and_a_test():
    free = {name for name, kernel in KERNELS.items() if kernel.limit is None}
    assert free == {"serial_all_scores", *LOOPS}
    assert set(TWINS) == KERNELS.keys() - {"serial_all_scores", "gradient", *LOOPS}
    assert all(kernel.counting for kernel in KERNELS.values())


@pytest.mark.equivalence
def test_closed_loops_are_timed_on_what_the_study_scores():
    settings = ["clock.duration=0.1"]
    for sensed, name in enumerate(LOOPS):
        work = KERNELS[name].prepare(3, settings)
        found = work.program(*work.arguments)
        problem = damping.problem_of(settings, sensed=bool(sensed))
        (numbers, keys), loop = work.arguments
        own = {path: values[1] for path, values in numbers.items()}
        alone = closed_loop.score(with_leaves(loop, own), key=keys[1], substeps=problem.substeps)
        np.testing.assert_allclose(found[1], alone, rtol=1e-9)
        assert (loop.sensor is None) == (name == "damping_loop")
        assert np.ptp(found[:, 1]) > 0.0


@pytest.mark.contract
def test_a_limit_in_nanoseconds_that_does_not_hold_is_named():
    row = measure_kernel(replace(toy(0.0), ns_limit=1e-9), None, repeats=1)
    assert (row.ok, row.ns_limit) == (False, 1e-9)
    assert "ns a step; at most 1e-09 ns is allowed" in row.note
    assert measure_kernel(replace(toy(0.0), ns_limit=1e15), None, repeats=1).ok


def toy(by: float) -> Kernel:
    """Return a kernel that compiles at once, with a twin that is wrong by a share."""
    x = np.linspace(1.0, 2.0, 6)

    def prepare(lanes, settings) -> Workload:
        return Workload(jax.jit(lambda x: 3.0 * x), (x,), 2, 3, 7.0, twin=lambda c: (1.0 + by) * 3.0 * x)

    return Kernel("toy", "a toy", 2, prepare, 1e9, "one")


@pytest.mark.contract
def test_what_disagrees_is_not_timed_against_c_and_says_so(c):
    bad = measure_kernel(toy(1e-8), c, repeats=1)
    assert (bad.ok, bad.ratio, bad.c_ns_per_step) == (False, None, None)
    assert bad.note.startswith("results differ from C's by 1e-08, more than 1e-09")
    good = measure_kernel(toy(0.0), c, repeats=2, peak=1.0)
    assert (good.ok, good.note, good.difference) == (True, "", 0.0)
    assert good.ratio is not None
    assert good.ratio > 0.0
    assert good.peak_share == pytest.approx(7.0 / good.ns_per_step)


@pytest.mark.contract
def test_a_limit_that_does_not_hold_is_named(c, monkeypatch):
    monkeypatch.setattr(measure, "COMPILE_LIMIT", 0.0)
    row = measure_kernel(replace(toy(0.0), limit=0.0), c, repeats=1)
    assert not row.ok
    assert "times the other's time; at most 0 is allowed; compiles for" in row.note


@pytest.mark.cli
def test_the_command_prints_rows_for_machines(vsajax, monkeypatch):
    monkeypatch.setitem(KERNELS, "toy", toy(0.0))
    ended = vsajax("bench", "--only", "toy", "--repeats", 1, "--json")
    found = json.loads(ended.out)
    (row,) = found["rows"]
    assert (ended.code, ended.err, found["ok"]) == (0, "", True)
    assert {"kernel", "lanes", "compile_s", "ns_per_step", "c_ns_per_step", "ratio", "limit", "ok"} <= row.keys()
    assert (row["kernel"], row["lanes"], row["ratio"], row["c_ns_per_step"]) == ("toy", 2, None, None)
    assert "a toy" in vsajax("bench", "--only", "toy", "--repeats", 1).out


@pytest.mark.cli
def test_the_command_fails_where_c_disagrees(c, vsajax, monkeypatch):
    monkeypatch.setitem(KERNELS, "toy", toy(1e-6))
    ended = vsajax("bench", "--against", "c", "--only", "toy", "--repeats", 1)
    assert ended.code == 1
    assert "toy: results differ from C's by 1e-06" in ended.out


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
    monkeypatch.setitem(KERNELS, "toy", toy(0.0))
    monkeypatch.setattr(record.read_record, "__defaults__", (path,))
    for recorded, code in ((1e-9, 1), (1e9, 0)):
        path.write_text(json.dumps({"ratios": {"toy": recorded}}), encoding="utf-8")
        ended = vsajax("bench", "--check", "--repeats", 1, "--json")
        assert ended.code == code
        (compared,) = json.loads(ended.out)["check"]
        assert (compared["kernel"], compared["recorded"], compared["ok"]) == ("toy", recorded, code == 0)
