"""A study of an arm through all commands that take one, and what they say of what cannot be."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from tuning.files.whole import write_table

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
    at_zero = settings("arm.pose_deg=[0.0,0.0,0.0,0.0]")
    assert "passive stiffness error: none, the pose is singular" in vsajax("stiffness", study, *at_zero).out
    stretched = answer(vsajax("stiffness", study, "--json", *at_zero))
    assert (stretched["status"], "passive_stiffness" in stretched) == ("singular", False)
    assert np.isfinite(stretched["serial_stiffness"]).all()
    assert stretched["errors"]["passive_stiffness_error"] is None

    # Whatever the numbers, no answer holds a nan, and what has no design says why.
    for given in ("task.stiffness=[1e-300,1e-300,1e-300]", "joints={lower=1e-200, upper=1e-200}"):
        ended = vsajax("stiffness", study, *settings(given))
        assert (ended.code, "nan" in ended.out, "inf" in ended.out) == (1, False, False), ended.out
        assert "no design: " in ended.out


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


@pytest.fixture(scope="module")
def elbowed() -> str:
    """A small arm: a turning base, a shoulder and an elbow, the last without end."""
    joints = [
        ("base", "waist", "upper", "revolute", "0 0 0.3", "0 0 1"),
        ("upper", "[deg] shoulder", "fore", "revolute", "0 0 0.1", "0 1 0"),
        ("fore", "elbow", "wrist", "continuous", "0.4 0 0", "0 1 0"),
        ("wrist", "flange", "hand", "fixed", "0.3 0 0", "0 0 0"),
    ]
    links = "".join(f'<link name="{name}"/>' for name in ("base", "upper", "fore", "wrist", "hand"))
    told = "\n".join(
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{place}"/><axis xyz="{axis}"/><limit lower="-1.5" upper="1.5"/></joint>'
        for parent, name, child, kind, place, axis in joints
    )
    return f'<robot name="elbowed">{links}\n{told}</robot>'


@pytest.fixture
def own(tmp_path, monkeypatch, elbowed) -> Path:
    """A study of that arm, so small that every command ends in seconds."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "elbowed.urdf").write_text(elbowed)
    path = tmp_path / "own.toml"
    path.write_text(
        'schema_version = 1\nkind = "arm"\n'
        'arm = {urdf = "elbowed.urdf", tip = "hand", pose_deg = [10.0, 200.0, 200.0]}\n'
        "joints = {lower = 50.0, upper = 500.0}\ntask = {stiffness = [200.0, 300.0, 400.0]}\n"
        "workspace = {poses = 8, cells = 4}\nposes = {targets = 2, starts = 2, steps = 2}\n"
        "accuracy = {msrep = [0.01, 1.0], draws = 8}\n"
    )
    return path


NAMES = ["waist", "[deg] shoulder", "elbow"]


def columns_of(path: Path) -> list[str]:
    return pq.read_schema(path).names


@pytest.mark.cli
def test_a_small_arm_of_a_urdf_goes_through_every_command_under_its_joints_names(vsajax, own, tmp_path):
    note = "arm.pose_deg puts joint 2 ([deg] shoulder) at 200, outside of its range of -85.9437 to 85.9437 deg"
    assert f"# note: {note}\n" in vsajax("check", own).out
    assert answer(vsajax("check", own, "--json"))["notes"] == [note]
    said = vsajax("stiffness", own)
    assert said.code == 0
    lines = said.out.splitlines()
    assert lines[0].split("  ")[0] == "joint"
    assert "pose [deg]" in lines[0]
    assert [line[:14].rstrip() for line in lines[1:4]] == NAMES
    assert lines[4] == f"note: {note}"
    found = answer(vsajax("stiffness", own, "--json", "-o", "one"))
    assert (found["joints"], found["outside"]) == (NAMES, [note])
    assert found["files"] == ["one/manifest.json", "one/stiffness.png"]

    mapped = answer(vsajax("workspace", own, "-o", "space", "--json"))
    assert (mapped["ok"], mapped["joints"], mapped["poses"]) == (True, NAMES, 8)
    stored = columns_of(tmp_path / "space" / "workspace.parquet")
    assert stored[:3] == [f"{name}_position" for name in NAMES]
    assert [name for name in stored if name.endswith("_stiffness")] == [f"{name}_stiffness" for name in NAMES]
    unmet = vsajax("workspace", own, "-o", "none", *settings("task.stiffness=[200.0, 300.0, 90000.0]"))
    assert unmet.code == 1
    assert "no pose has a design that can be used: 8 of 8: the desired stiffness is above the largest" in unmet.out
    empty = vsajax("workspace", own, "-o", "none", *settings("task.stiffness=[1e-300, 1e-300, 1e-300]"))
    assert (empty.code, "–" in empty.out, "nan" in empty.out) == (1, False, False)
    assert "no pose has a design that can be used: 8 of 8: the solver stopped" in empty.out

    better = answer(vsajax("poses", own, "-o", "better", "--json"))
    medians = list(better["median_error"].values())
    assert medians[0] >= medians[1] >= medians[3]
    assert (better["ok"], better["unreached"], better["joints"]) == (True, 0, NAMES)
    assert columns_of(tmp_path / "better" / "poses.parquet")[-3:] == [f"{name}_position" for name in NAMES]
    lost = vsajax("poses", own, "-o", "nowhere", *settings("task.stiffness=[1e-300, 1e-300, 1e-300]"))
    assert (lost.code, "nan" in lost.out, "inf" in lost.out) == (1, False, False)
    assert "no target has a pose whose passive error has a value: `vsajax stiffness`" in lost.out

    costs = answer(vsajax("montecarlo", own, "-o", "costs", "--json"))
    assert (costs["ok"], costs["joints"], [row["failed"] for row in costs["levels"]]) == (True, NAMES, [0, 0])
    assert costs["levels"][0]["stiffness_change_median"] < costs["levels"][1]["stiffness_change_median"]
    lost = vsajax("montecarlo", own, "-o", "lost", *settings("task.stiffness=[1e-300, 1e-300, 1e-300]"))
    assert (lost.code, "nan" in lost.out) == (1, False)
    assert "no arm has a hand whose stiffness has a value" in lost.out
    for picture in ("one/stiffness.png", "space/workspace.png", "better/poses.png", "costs/accuracy.png"):
        assert (tmp_path / picture).read_bytes().startswith(b"\x89PNG")

    for run, headline, said in (
        ("one", "the desired stiffness is ", "[deg] shoulder"),
        ("space", "of 8 poses", "passive stiffness error"),
        ("better", "Median passive error over 2 targets", "searched from 2 poses"),
        ("costs", "At an MSREP of 1 % in the joints", "against designed"),
        ("none", "No pose has a design that can be used", "not optimal"),
        ("lost", "No arm has a hand whose stiffness has a value", "failed"),
    ):
        told = answer(vsajax("report", run, "--json"))
        assert headline in told["headline"]
        assert told["pictures"] == 1
        page = (tmp_path / run / "report.html").read_text()
        assert said in page
        assert "nan" not in page.split("base64")[0]
    refused = vsajax("report", "one", "space")
    assert (refused.code, "no report in pairs" in refused.err) == (2, True)
    refused = vsajax("workspace", own, "-o", "better")
    assert (refused.code, "better: holds a run of vsajax poses" in refused.err) == (2, True)
    (tmp_path / "space" / "workspace.parquet").write_bytes((tmp_path / "none" / "workspace.parquet").read_bytes())
    refused = vsajax("report", "space")
    assert (refused.code, "workspace.parquet" in refused.err) == (2, True)
    manifest = tmp_path / "better" / "manifest.json"
    manifest.write_text(manifest.read_text().replace('"draws": 8', '"draws": 9'))
    refused = vsajax("report", "better")
    assert (refused.code, "manifest.json: does not hold what was written" in refused.err) == (2, True)


@pytest.mark.cli
@pytest.mark.failure
@pytest.mark.parametrize("command", ["check", "stiffness", "workspace", "poses", "montecarlo", "export"])
def test_every_command_opens_the_urdf_and_refuses_what_is_wrong_with_it(vsajax, own, tmp_path, elbowed, command):
    output = {"check": [], "stiffness": [], "export": ["--to", "toml", "-o", "run"]}.get(command, ["-o", "run"])
    before = sorted(tmp_path.rglob("*"))

    def refused(*given: str) -> str:
        ended = vsajax(command, own, *output, *settings(*given))
        assert (ended.code, ended.out) == (2, "")
        return ended.err

    assert "own.toml: arm.tip: got 'hnd'" in (said := refused("arm.tip=hnd"))
    assert "fix: did you mean hand? tips of " in said
    assert "elbowed.urdf: hand, upper, fore, wrist" in said
    assert "own.toml: joints.lower: got 2 numbers; the arm has 3 joints: waist, [deg] shoulder, elbow" in refused(
        "joints.lower=[1.0,2.0]"
    )
    assert "joint 2 ([deg] shoulder) has lower 90 above upper 60" in refused(
        "joints={lower=[1.0,90.0,1.0], upper=60.0}"
    )
    assert "arm.pose_deg: got 1 angles; the arm has 3 joints: waist" in refused("arm.pose_deg=[1.0]")
    assert "arm.pose_deg: joint 1 (waist) has 1e+09; allowed: within" in refused("arm.pose_deg=[1e9,0.0,0.0]")
    assert "arm.urdf: " in refused("arm.urdf=elbow.urdf")
    (tmp_path / "elbowed.urdf").write_text(elbowed[: len(elbowed) // 2])
    assert "elbowed.urdf: line 3, column " in (said := refused())
    assert "the file was cut off: fetch it again" in said
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.cli
@pytest.mark.failure
def test_a_preset_of_an_arm_is_opened_too(vsajax, own, tmp_path):
    preset = tmp_path / "preset.toml"
    preset.write_text('urdf = "elbowed.urdf"\ntip = "finger"\n')
    ended = vsajax("check", preset)
    assert (ended.code, ended.out) == (2, "")
    assert "arm.tip: got 'finger'" in ended.err
    assert "tips of " in ended.err
    preset.write_text('urdf = "elbowed.urdf"\ntip = "hand"\n')
    assert vsajax("check", preset).code == 0


@pytest.mark.slow(twin="test_a_small_arm_of_a_urdf_goes_through_every_command_under_its_joints_names")
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
    names = [f"panda_joint{i + 1}" if source == "urdf" else f"joint_{i + 1}" for i in range(joints)]
    stiffness = np.stack([table[f"{name}_stiffness"] for name in names])
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
    lost = answer(vsajax("montecarlo", study, "-o", "lost", "--scenarios", "200", "--json", *own))["levels"][1]
    assert lost["failed"] == pytest.approx(200 * (1 - 0.8**joints), abs=30)

    for picture in ("space/workspace.png", "poses/poses.png", "accuracy/accuracy.png"):
        assert (tmp_path / picture).read_bytes().startswith(b"\x89PNG")
