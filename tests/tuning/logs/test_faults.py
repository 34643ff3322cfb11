"""A gap, a swapped sign, degrees for radians, a wrapped encoder, a truncated file: each is found and named."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tuning.logs.robot_logs import look_at, names, spring_log, with_gap, wrapped, write_spring_log
from tuning.files.errors import InputError
from tuning.logs.faults import resolution
from tuning.logs.reading import read_recording

DEGREES = 180.0 / np.pi


def test_a_good_log_has_no_faults(tmp_path):
    for seed in range(10):
        _, analysis = look_at(write_spring_log(tmp_path, spring_log(seed=seed, amplitude=0.02 * (seed + 1))))
        assert analysis.faults == ()


def test_a_gap_of_300_ms_is_reported_where_it_is(tmp_path):
    columns = with_gap(spring_log(), 150, 0.3)
    table, _ = look_at(write_spring_log(tmp_path, columns))
    gap = table.clock.gaps[0]
    assert gap.length == pytest.approx(0.3, abs=1e-9)
    assert gap.start == pytest.approx(columns["time"][150] - columns["time"][0], abs=1e-9)
    assert any(note.startswith(f"largest gap 300 ms at t = {gap.start:.4g} s") for note in table.notes)
    assert len(table.clock.gaps) == 1


@pytest.mark.parametrize("signal", ["torque", "deflection", "motor"])
def test_a_swapped_sign_is_named(tmp_path, signal):
    columns = spring_log()
    _, analysis = look_at(write_spring_log(tmp_path, columns | {signal: -columns[signal]}))
    assert "swapped sign" in names(analysis)
    assert all("sign" in fault.fix for fault in analysis.faults if fault.name == "swapped sign")


@pytest.mark.parametrize("signals", [("link", "motor", "deflection"), ("deflection",), ("link",), ("motor",)])
def test_degrees_taken_for_radians_are_named(tmp_path, signals):
    columns = spring_log()
    columns |= {name: DEGREES * columns[name] for name in signals}
    _, analysis = look_at(write_spring_log(tmp_path, columns))
    assert "degrees for radians" in names(analysis)


def test_an_encoders_step_tells_degrees_from_radians(tmp_path):
    log = "time,deflection,elastic_torque\n" + "".join(
        f"{0.002 * i:.3f},{360 / 4096 * round(8 * np.sin(0.05 * i))!r},{float(np.sin(0.05 * i))!r}\n"
        for i in range(300)
    )
    path = tmp_path / "log.csv"
    path.write_text(log)
    (fault,) = read_recording(path, kind="sea").faults
    assert (fault.name, fault.signal) == ("degrees for radians", "deflection")
    assert "4096 a turn in degrees, but 71.49 in radians" in fault.problem


def test_radians_of_an_encoder_are_no_degrees(tmp_path):
    angles = [2 * np.pi / 16384 * round(60 * np.sin(0.05 * i)) for i in range(300)]
    path = tmp_path / "log.csv"
    rows = "".join(f"{0.002 * i:.3f},{a!r},{70 * a!r}\n" for i, a in enumerate(angles))
    path.write_text("time,deflection,elastic_torque\n" + rows)
    table = read_recording(path, kind="sea")
    assert table.faults == ()
    assert table.resolutions["deflection"] == pytest.approx(2 * np.pi / 16384, rel=1e-6)


@pytest.mark.analytic
def test_a_resolution_is_found_whatever_the_zero():
    rng = np.random.default_rng(1)
    counts = np.round(40 * np.sin(np.linspace(0, 9, 3000)) + rng.normal(size=3000))
    assert resolution(0.123 + counts * 0.00314) == pytest.approx(0.00314, rel=1e-9)
    assert resolution(rng.normal(size=3000)) is None


@pytest.mark.parametrize("period", [2 * np.pi, np.pi])
def test_a_wrapped_encoder_is_named_with_its_period_and_line(tmp_path, period):
    columns = spring_log()
    # The joint turns far enough for the counter to start again.
    far = {"link": columns["link"] + period / 2, "motor": columns["motor"] + 0.4}
    columns |= {name: wrapped(values, period) for name, values in far.items() if name == "link"}
    path = write_spring_log(tmp_path, columns)
    _, analysis = look_at(path)
    (fault,) = [f for f in analysis.faults if f.name == "wrapped encoder"]
    assert fault.signal == "link_position"
    first = int(np.argmax(np.abs(np.diff(columns["link"])) > period / 2))
    assert f"between line {first + 2} and line {first + 3}" in fault.problem
    assert f"wraps_at = {period:.10g}" in fault.fix
    # What it says to do mends it.
    path = write_spring_log(tmp_path, columns, link=f"wraps_at = {period:.10g}")
    _, mended = look_at(path)
    assert "wrapped encoder" not in names(mended)


def test_a_truncated_parquet_is_refused(tmp_path):
    path = write_spring_log(tmp_path, spring_log(), ".parquet")
    content = path.read_bytes()
    for share in (0.1, 0.5, 0.9, 0.999):
        path.write_bytes(content[: int(share * len(content))])
        with pytest.raises(InputError, match=r"(?s)cannot be read as a Parquet file.*cut short"):
            look_at(path)


def test_a_signal_that_never_moves_or_leaves_its_range_is_named(tmp_path):
    columns = spring_log()
    _, analysis = look_at(write_spring_log(tmp_path, columns | {"link": np.full(400, 0.5)}))
    assert "frozen signal" in names(analysis)
    _, analysis = look_at(write_spring_log(tmp_path, columns, torque="range = [-1, 1]"))
    (fault,) = analysis.faults
    assert (fault.name, fault.signal) == ("out of range", "elastic_torque")


def test_a_stiffness_that_is_not_as_expected_is_named(tmp_path):
    columns = spring_log()
    _, analysis = look_at(write_spring_log(tmp_path, columns | {"torque": 10 * columns["torque"]}))
    assert any(f.name == "out of range" and f.signal == "stiffness" for f in analysis.faults)
