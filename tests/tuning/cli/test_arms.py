"""A study of an arm through all commands that take one, and what they say of what cannot be."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from tuning.logs.files import write_table

PANDA = Path(__file__).parents[2] / "golden" / "panda" / "panda.urdf"


def answer(ended, code: int = 0) -> dict:
    assert (ended.code, ended.err) == (code, "")
    return json.loads(ended.out)


@pytest.fixture
def study(vsajax, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert vsajax("init", "arm", "arm.toml").code == 0
    return tmp_path / "arm.toml"


def settings(*given: str) -> list[str]:
    return [word for setting in given for word in ("--set", setting)]


@pytest.mark.cli
def test_a_pose_is_designed_or_what_is_wrong_with_it_is_said(vsajax, study):
    # One program serves all: only numbers change.
    found = answer(vsajax("stiffness", study, "--json"))
    assert (found["ok"], found["status"], found["is_exact"]) == (True, "solved", True)
    assert found["held"] == ["lower", "free", "free", "lower"]
    np.testing.assert_allclose(found["serial_stiffness"], np.diag([100.0, 100.0, 300.0]), atol=1e-9)
    np.testing.assert_allclose(
        found["joint_stiffness"], [423.267585, 132.111237, 121.456567, 172.959597], rtol=1e-7
    )
    said = vsajax("stiffness", study).out
    assert "the desired stiffness is met exactly; passive compliances × 0.93" in said

    stiff = answer(vsajax("stiffness", study, "--json", *settings("task.stiffness=[100.0,100.0,9000.0]")), 1)
    assert (stiff["ok"], stiff["status"]) == (False, "unreachable")
    assert "above the largest active stiffness" in stiff["meaning"]
    stretched = answer(vsajax("stiffness", study, "--json", *settings("arm.pose_deg=[0.0,0.0,0.0,0.0]")))
    assert (stretched["status"], "passive_stiffness" in stretched) == ("singular", False)
    assert np.isfinite(stretched["serial_stiffness"]).all()
    assert stretched["errors"]["passive_stiffness_error"] is None


@pytest.mark.cli
@pytest.mark.failure
@pytest.mark.parametrize("command", ["check", "stiffness", "workspace", "poses", "montecarlo"])
def test_every_command_refuses_what_has_no_answer(command, vsajax, study, tmp_path):
    before = sorted(tmp_path.rglob("*"))
    output = () if command in ("check", "stiffness") else ("-o", "run")
    for given, said in (
        ("task.stiffness=[100.0,-100.0,300.0]", ["task.stiffness: is not positive definite", "above 0"]),
        ("task.stiffness=[100.0,nan,300.0]", ["task.stiffness", "finite"]),
        ("task.stiffness=[100.0,100.0]", ["task.stiffness: got 2 rows; space 'position' needs 3", "diagonal"]),
        (
            "task.stiffness=[[1.0,2.0,0.0],[0.0,1.0,0.0],[0.0,0.0,1.0]]",
            ["not symmetric: row 2 has 0, row 1 has 2"],
        ),
        ("joints.upper=60.0", ["joints: joint 1 has lower 394 above upper 60", "exchange them"]),
        ("joints.lower=[1.0,2.0]", ["joints.lower: got 2 numbers; the arm has 4 joints"]),
        ("joints.upper=inf", ["joints.upper", "finite"]),
        ("joints.lower=0.0", ["joints.lower", "greater than 0"]),
        ("task.load=[1.0,2.0]", ["task.load", "3"]),
        ("arm.pose_deg=[1.0]", ["arm.pose_deg: got 1 angles; the arm has 4 joints"]),
        ("poses.drawn_deg=[[0.0,1.0]]", ["poses.drawn_deg: got 1 pairs; the arm has 4 joints"]),
        ("poses.drawn_deg=[[1.0,0.0]]", ["poses", "low, then high"]),
        ("arm.preset=leg", ["arm.preset: got 'leg'", "hand-arm-4"]),
        ("poses.targets=0", ["poses.targets: got 0"]),
    ):
        ended = vsajax(command, study, *output, *settings(given))
        assert (ended.code, ended.out) == (2, ""), given
        for words in ("error: ", *said):
            assert words in ended.err, (given, ended.err)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.cli
@pytest.mark.failure
def test_what_only_the_kinematics_know_is_refused_too(vsajax, study):
    drawn = "poses.drawn_deg=[[0.0,10.0],[0.0,10.0],[0.0,10.0],[0.0,170.0]]"
    ended = vsajax("poses", study, "-o", "run", *settings(drawn))
    assert ended.code == 2
    assert (
        "poses.drawn_deg: joint 4 has 0 to 170; its range is 5 to 145\n    fix: stay within the range" in ended.err
    )
    ended = vsajax("montecarlo", study, "-o", "run", *settings("accuracy.run=nothing"))
    assert ended.code == 2
    assert "accuracy.run: " in ended.err
    assert "is no finished run" in ended.err


@pytest.mark.slow
@pytest.mark.cli
@pytest.mark.parametrize("source", ["preset", "urdf"])
def test_an_arm_goes_through_the_whole_pipeline(source, vsajax, study, tmp_path):
    if source == "urdf":
        text = study.read_text().replace('preset = "hand-arm-4"', f'urdf = "{PANDA}"\ntip = "panda_hand_tcp"')
        lines = [line for line in text.splitlines() if not line.startswith(("pose_deg", "lower"))]
        text = "\n".join(lines).replace("upper = 500.0", "lower = 50.0\nupper = 500.0")
        text = text.replace('"position" ', '"pose" ').replace(
            "[100.0, 100.0, 300.0]", "[500.0, 500.0, 500.0, 50.0, 50.0, 50.0]"
        )
        study.write_text(text)
    joints, size = (7, 6) if source == "urdf" else (4, 3)
    assert vsajax("check", study).code == 0
    found = answer(vsajax("stiffness", study, "--json"))
    assert np.shape(found["joint_stiffness"]) == (joints,)
    assert np.shape(found["serial_stiffness"]) == (size, size)
    assert found["errors"]["compliance_error"] <= found["errors"]["passive_compliance_error"]

    mapped = answer(vsajax("workspace", study, "-o", "space", "--json", *settings("workspace.poses=500")))
    stored = pq.read_table(tmp_path / "space" / "workspace.parquet")
    table = {name: stored[name].to_numpy() for name in stored.column_names}
    assert stored.num_rows == mapped["poses"] == sum(mapped["statuses"].values()) == 500
    assert mapped["statuses"]["solved"] + mapped["statuses"]["singular"] == 500
    assert mapped["exact_share"] == pytest.approx(table["is_exact"].mean())
    assert (table["stiffness_error"][table["is_exact"]] < 1e-10).all()
    assert (table["compliance_error"][~table["is_exact"]] > 1e-14).all()
    stiffness = np.stack([table[f"joint_{i + 1}_stiffness"] for i in range(joints)])
    assert stiffness.min() > 50.0 * (1 - 1e-9)
    assert stiffness.max() < 500.0 * (1 + 1e-9)

    few = settings("poses.targets=16", "poses.starts=3", "poses.steps=20")
    better = answer(vsajax("poses", study, "-o", "poses", "--json", *few))
    medians = list(better["median_error"].values())
    assert medians[0] >= medians[1] >= medians[3]
    assert medians[2] >= medians[3]
    assert better["largest_shift"] < 1e-7

    rows = answer(vsajax("montecarlo", study, "-o", "accuracy", "--scenarios", "200", "--json"))["levels"]
    changes = [row["stiffness_change_median"] for row in rows]
    assert changes == sorted(changes)
    # Small errors of the joints pass to the hand in proportion: their square is MSREP.
    assert changes[1] / changes[0] == pytest.approx(np.sqrt(10.0), rel=0.02)
    assert [row["failed"] for row in rows] == [0] * len(rows)

    write_table(tmp_path / "robots" / "results.parquet", {"msrep_settled": [rows[1]["msrep"]] * 5})
    own = settings("accuracy.run=robots", f"accuracy.msrep=[{rows[1]['msrep']}]")
    level, run = answer(vsajax("montecarlo", study, "-o", "own", "--scenarios", "200", "--json", *own))["levels"]
    assert run["msrep"] == "run"
    assert run["stiffness_change_median"] == pytest.approx(level["stiffness_change_median"], rel=1e-9)
    write_table(tmp_path / "robots" / "results.parquet", {"msrep_settled": [np.nan, *[rows[1]["msrep"]] * 4]})
    lost = answer(vsajax("montecarlo", study, "-o", "own", "--scenarios", "200", "--json", *own))["levels"][1]
    assert lost["failed"] == pytest.approx(200 * (1 - 0.8**joints), abs=30)

    for picture in ("space/workspace.png", "poses/poses.png", "accuracy/accuracy.png"):
        assert (tmp_path / picture).read_bytes().startswith(b"\x89PNG")
