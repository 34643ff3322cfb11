"""Which sentences a recording brings about, and which it must not: clean ones, and every fault."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.tuning.logs.joints import STEP, recordings
from tuning.files.shipped import CONFIGS
from tuning.kinds.estimation.study import EstimationStudy
from tuning.kinds.log.answer import Answer, estimate_recording
from tuning.logs.analysis import Analysis, analyse
from tuning.logs.reading import read_recording
from tuning.logs.torques import Assumptions
from tuning.problem.replay import simulate
from tuning.study.loading import load_study

Columns = dict[str, np.ndarray]
NO_OFFSET = Assumptions(has_offset=False)
CAUSES = ("HYSTERESIS", "SOFTENING", "STIFFENING", "slipped", "nan")


@pytest.fixture(scope="module")
def clean() -> list[Columns]:
    """Return stiff joints, whose deflection is a small part of their motion."""
    return recordings(6, seed=7, stiffness=(40.0, 150.0))


def look(folder: Path, columns: Columns, given: Assumptions | None = None) -> Analysis:
    """Return what a recording without a map says."""
    pq.write_table(pa.table(columns), folder / "log.parquet")
    table = read_recording(folder / "log.parquet", kind="sea")
    own = table.columns
    bent = own["deflection"] if "deflection" in own else own["link_position"] - own["motor_position"]
    return analyse(table, bent, own["elastic_torque"], given)


def _changed(signal: str, at: slice | list[int], value: float | Callable[[np.ndarray], np.ndarray]):
    def change(columns: Columns) -> Columns:
        values = columns[signal].copy()
        values[at] = value(values[at]) if callable(value) else value
        return columns | {signal: values}

    return change


def _bend(columns: Columns) -> np.ndarray:
    return columns["link_position"] - columns["motor_position"]


def _late(samples: int) -> Callable[[Columns], Columns]:
    def change(columns: Columns) -> Columns:
        cut = {name: values[samples:] for name, values in columns.items()}
        return cut | {"elastic_torque": columns["elastic_torque"][:-samples]}

    return change


def _clipped(signal: str, share: float) -> Callable[[Columns], Columns]:
    def change(columns: Columns) -> Columns:
        values = columns[signal] - columns[signal].mean()
        limit = share * np.abs(values).max()
        return columns | {signal: np.clip(values, -limit, limit)}

    return change


def _geared(factor: float, *, measured: bool) -> Callable[[Columns], Columns]:
    def change(columns: Columns) -> Columns:
        extra = {"deflection": _bend(columns)} if measured else {}
        return columns | extra | {"motor_position": factor * columns["motor_position"]}

    return change


def _unsprung(columns: Columns) -> Columns:
    return columns | {"link_position": columns["motor_position"]}


def _foreign(columns: Columns) -> Columns:
    """Return the torque of another joint, which swings at other frequencies."""
    time = columns["time"]
    return columns | {"elastic_torque": np.sin(2 * np.pi * 0.7 * time) + 0.4 * np.sin(2 * np.pi * 3.7 * time)}


def _offset(columns: Columns) -> Columns:
    torque = columns["elastic_torque"]
    return columns | {"elastic_torque": torque - torque.mean() + 0.5 * np.ptp(torque)}


MIDDLE = slice(1000, 1400)
FAULTS = {
    "an outlier of the torque": (
        _changed("elastic_torque", [1233], lambda x: 1e6 * x + 1e3),
        "spikes",
        "row 1234 ",
    ),
    "a turn of the link": (
        _changed("link_position", [50, 700], lambda x: x + 2 * np.pi),
        "spikes",
        "off by a turn",
    ),
    "two samples lost": (_changed("motor_position", [700, 701], 3.0), "spikes", "rows 701 to 702 "),
    "torque off": (_changed("elastic_torque", MIDDLE, 0.0), "zeroed signal", "rows 1001 to 1400 "),
    "torque off at the end": (_changed("elastic_torque", slice(2000, None), 0.0), "zeroed signal", "to 3000 "),
    "torque held": (_changed("elastic_torque", MIDDLE, lambda x: x[:1]), "held signal", "rows 1001 to 1400 "),
    "link held": (_changed("link_position", MIDDLE, lambda x: x[:1]), "held signal", "link_position"),
    "torque cut off": (_clipped("elastic_torque", 0.5), "saturated signal", "elastic_torque stays at -"),
    "half the gear, deflection measured": (_geared(2.0, measured=True), "wrong gear ratio", "+100 %"),
    "half the gear": (_geared(2.0, measured=False), "wrong gear ratio", "gear ratio of "),
    "101 for 100, deflection measured": (_geared(1 / 1.01, measured=True), "wrong gear ratio", "ratio of 0.9"),
    "101 for 100": (_geared(1 / 1.01, measured=False), "wrong gear ratio", "ratio of 0.9"),
    "torque late by 20 ms": (_late(10), "late torque", "ms"),
    "torque late by 6 ms": (_late(3), "late torque", "ms"),
    "one encoder twice": (_unsprung, "rigid drive", "is 0 rad in every sample"),
    "the torque of another joint": (_foreign, "unrelated torque", "explains"),
    "an offset without a term": (_offset, "torque offset", "estimator.basis.torque_bias = true"),
}


@pytest.mark.parametrize("case", FAULTS)
def test_a_fault_is_named_with_its_place_and_nothing_else_is_claimed(case, clean, tmp_path):
    change, name, words = FAULTS[case]
    given = NO_OFFSET if name == "torque offset" else None
    for columns in clean[:3]:
        analysis = look(tmp_path, change(columns), given)
        assert [fault.name for fault in analysis.faults] == [name]
        assert analysis.is_faulty
        assert words in str(analysis.faults[0])
        said = analysis.sentences()
        assert said[0].startswith(f"WARNING: {name}: ")
        assert not [word for word in CAUSES if word in " ".join(said)]


@pytest.mark.parametrize("case", ["an outlier of the torque", "torque off", "torque held", "link held"])
def test_what_a_fault_concerns_is_left_out_of_the_line(case, clean, tmp_path):
    for columns in clean[:3]:
        own, mended = (look(tmp_path, x).characteristic for x in (columns, FAULTS[case][0](columns)))
        assert own is not None
        assert mended is not None
        assert mended.stiffness == pytest.approx(own.stiffness, rel=0.02)


@pytest.mark.parametrize("milliseconds", [6, 20, 50])
def test_a_late_torque_is_late_by_its_milliseconds(milliseconds, clean, tmp_path):
    samples = round(1e-3 * milliseconds / STEP)
    for columns in clean[:3]:
        (fault,) = look(tmp_path, _late(samples)(columns)).faults
        found = float(fault.problem.split(" by ")[1].split(" ms")[0])
        assert found == pytest.approx(milliseconds, abs=1.0)


def test_a_late_deflection_is_no_hysteresis(clean, tmp_path):
    for columns in clean[:3]:
        late = {name: values[:-10] for name, values in columns.items()}
        analysis = look(tmp_path, late | {"elastic_torque": columns["elastic_torque"][10:]})
        assert [(fault.name, fault.severity) for fault in analysis.faults] == [("early torque", "note")]
        assert "HYSTERESIS" not in " ".join(analysis.sentences())


def test_a_joint_angle_for_the_deflection_is_never_a_swapped_sign(tmp_path):
    for columns in recordings(12, seed=3):
        angles = {"time": columns["time"], "elastic_torque": columns["elastic_torque"]}
        analysis = look(tmp_path, angles | {"deflection": columns["link_position"]})
        line = analysis.characteristic
        assert line is not None
        swapped = [fault for fault in analysis.faults if fault.name == "swapped sign"]
        assert bool(swapped) is (analysis.correlation < -0.9)
        assert all("another angle" in fault.fix for fault in swapped)
        assert "HYSTERESIS, S" not in " ".join(analysis.sentences())


def test_who_moves_slowly_is_not_at_rest(clean, tmp_path):
    # A chirp from slow on, with its encoder's counts.
    time = np.arange(0.0, 10.0, STEP)
    swing = 0.04 * (1.0 - np.cos(2 * np.pi * (0.02 * time + 0.1 * time**2)))
    counts = 1e-4 * np.round(swing / 1e-4)
    rng = np.random.default_rng(0)
    columns = {
        "time": time,
        "deflection": counts,
        "elastic_torque": 60 * swing + 0.02 * rng.normal(size=time.size),
    }
    analysis = look(tmp_path, columns)
    assert analysis.rest is None
    assert "at rest" not in " ".join(analysis.sentences())


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 8))])
def test_a_clean_recording_makes_no_warning_and_no_hysteresis(seed, tmp_path):
    for number, columns in enumerate(recordings(24, seed=seed)):
        for given in (None, Assumptions(is_matched=False)):
            analysis = look(tmp_path, columns, given)
            said = " ".join(analysis.sentences())
            assert not analysis.is_faulty, (number, said)
            assert {fault.name for fault in analysis.faults} <= {"coarse deflection"}, (number, said)
            assert not [w for w in ("HYSTERESIS", "SOFTENING", "slipped", "DIFFER", "nan") if w in said], (
                number,
                said,
            )


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_spring_with_dry_friction_inside_makes_no_warning(seed, tmp_path):
    named = 0
    for number, columns in enumerate(recordings(12, seed=seed, dry=True)):
        analysis = look(tmp_path, columns)
        said = " ".join(analysis.sentences())
        assert not analysis.is_faulty, (number, said)
        assert "nan" not in said
        named += "HYSTERESIS" in said or "DIFFER" in said
    # The others' loops are a smaller part of what the torque does.
    assert named >= 2


def test_a_set_point_that_moves_leaves_the_line_unsaid(clean, tmp_path):
    time = clean[0]["time"]
    setpoint = np.sin(0.5 * time)
    bent = 0.01 * np.sin(7.0 * time)
    torque = (80.0 + 60.0 * setpoint) * bent + 0.005 * np.random.default_rng(1).normal(size=time.size)
    motor = 0.4 * np.sin(2.0 * time)
    columns = {"time": time, "link_position": motor + bent, "motor_position": motor, "elastic_torque": torque}
    pq.write_table(pa.table(columns | {"setpoint_position": 60.0 * setpoint}), tmp_path / "log.parquet")
    table = read_recording(tmp_path / "log.parquet", kind="serial")
    analysis = analyse(table, bent, torque, NO_OFFSET)
    # Set-point motors turn as often as they like.
    assert analysis.faults == ()
    assert analysis.sentences() == []


SEA = "estimator.gate.min_deflection_range=0.002"
RESIDUAL = (
    'estimator.torque={type="residual",observer_gain=100.0,motor_inertia=2e-5,motor_damping=1e-3,gear_ratio=80.0,'
    "friction_torque=0.002}"
)
SIMULATED = {
    "serial": ("serial", ()),
    "sea": ("sea", (SEA,)),
    "a soft spring under a heavy link": ("sea", ('joint.spring={type="linear",rate=8.0}',)),
    "motor data": ("sea", (SEA, RESIDUAL, "estimator.matched=true")),
}


def _simulated(name: str, settings: tuple[str, ...], folder: Path, *, seed: int = 0, share: float = 1.0) -> Answer:
    study = load_study(CONFIGS / "studies" / f"{name}.toml", (*settings, f"seed={seed}"))
    assert isinstance(study, EstimationStudy)
    columns, _ = simulate(study, 0)
    cut = {signal: values[: int(share * len(values))] for signal, values in columns.items()}
    pq.write_table(pa.table(cut), folder / "log.parquet")
    return estimate_recording(study, read_recording(folder / "log.parquet", kind=study.kind))


@pytest.mark.parametrize("case", ["serial", "sea"])
def test_a_simulated_recording_makes_no_warning(case, tmp_path):
    said = _simulated(*SIMULATED[case], tmp_path).sentences
    assert not [s for s in said if "WARNING" in s or "nan" in s or "HYSTERESIS" in s or "slipped" in s]
    if case == "serial":
        # One stiffness is not claimed where the set-point moves.
        assert not [s for s in said if "a line explains" in s or "ONE STIFFNESS" in s]


@pytest.mark.slow(twin="test_a_simulated_recording_makes_no_warning")
@pytest.mark.parametrize("seed", range(1, 21))
@pytest.mark.parametrize("case", SIMULATED)
def test_no_simulated_recording_makes_a_warning(case, seed, tmp_path):
    rng = np.random.default_rng(seed)
    name, settings = SIMULATED[case]
    if name == "serial":
        settings = (*settings, f"excitation.setpoint_motor.amplitude={rng.uniform(1.0, 8.0)}")
    else:
        settings = (
            *settings,
            f"joint.link.inertia={rng.uniform(0.02, 0.1)}",
            f"joint.link.gravity={rng.uniform(0, 2)}",
        )
    said = _simulated(name, settings, tmp_path, seed=seed).sentences
    assert not [s for s in said if "WARNING" in s or "nan" in s or "HYSTERESIS" in s or "slipped" in s]


def test_a_recording_that_ends_before_scores_settle_says_so_and_never_nan(tmp_path):
    said = " ".join(_simulated("serial", (), tmp_path, share=0.15).sentences)
    assert "nan" not in said
    assert "the recording ends before 2 s" in said


def test_what_is_not_known_is_so_for_a_reason(tmp_path):
    answer = _simulated("sea", (), tmp_path)
    assert not answer.summary["known_share"]
    reason = answer.summary["unknown_because"]
    assert (
        "the deflection moves by 11.1 mrad in all, and estimator.gate.min_deflection_range asks for 20" in reason
    )
