"""A URDF is read whole or refused by line and joint: every class of fault that a file of others may have."""

from __future__ import annotations

import re
from math import pi
from pathlib import Path

import numpy as np
import pytest

from tuning.files.errors import InputError
from tuning.kinds.arm import urdf_xml
from tuning.kinds.arm.urdf import read_chain

LINES = [
    '<?xml version="1.0"?>',
    '<robot name="two" xmlns:xacro="http://www.ros.org/wiki/xacro">',
    '  <link name="base"/>',
    '  <joint name="shoulder" type="revolute">',
    '    <parent link="base"/>',
    '    <child link="upper"/>',
    '    <origin xyz="0 0 0.3" rpy="0 0.5 0"/>',
    '    <axis xyz="0 0 2"/>',
    '    <limit lower="-1.5" upper="2" effort="10" velocity="1"/>',
    "  </joint>",
    '  <link name="upper"><inertial><mass value="1"/></inertial></link>',
    '  <joint name="elbow" type="continuous">',
    '    <parent link="upper"/>',
    '    <child link="fore"/>',
    '    <origin xyz="0.4 0 0"/>',
    "  </joint>",
    '  <link name="fore"/>',
    '  <joint name="flange" type="fixed">',
    '    <parent link="fore"/>',
    '    <child link="hand"/>',
    '    <origin rpy="0 0 1"/>',
    '    <axis xyz="0 0 0"/>',
    "  </joint>",
    '  <link name="hand"/>',
    '  <gazebo reference="hand"><joint name="elbow"/><note text="${left} in"/></gazebo>',
    "</robot>",
]
WHOLE = "\n".join(LINES) + "\n"


@pytest.fixture
def read(tmp_path):
    def read(content: str | bytes, tip: str | None = "hand", base: str | None = None):
        path = tmp_path / "robot.urdf"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return read_chain(path, base, tip, "study.toml: arm")

    return read


def refusal(read, content: str | bytes, **options: str | None) -> str:
    with pytest.raises(InputError) as caught:
        read(content, **options)
    told = str(caught.value)
    assert told.count("\n    fix: ") == len(caught.value.mistakes)
    assert told.replace("\n", "").isprintable()
    return told


def test_a_chain_is_what_its_file_says(read):
    chain = read(WHOLE)
    assert chain.names == ("shoulder", "elbow")
    assert chain.titles == ["joint 1 (shoulder)", "joint 2 (elbow)"]
    np.testing.assert_array_equal(chain.offsets, [[0, 0, 0.3], [0.4, 0, 0]])
    np.testing.assert_array_equal(chain.axes, [[0, 0, 1], [1, 0, 0]])
    np.testing.assert_array_equal(chain.ranges, [[-1.5, 2], [-pi, pi]])
    c, s = np.cos([0.5, 1.0]), np.sin([0.5, 1.0])
    np.testing.assert_allclose(chain.rotations[0], [[c[0], 0, s[0]], [0, 1, 0], [-s[0], 0, c[0]]], atol=1e-16)
    np.testing.assert_allclose(chain.tool_rotation, [[c[1], -s[1], 0], [s[1], c[1], 0], [0, 0, 1]], atol=1e-16)


@pytest.mark.failure
def test_a_file_that_was_cut_off_anywhere_is_refused(read):
    whole, end = WHOLE.encode(), WHOLE.index("</robot>") + len("</robot>")
    for size in range(end):
        told = refusal(read, whole[:size])
        if size > WHOLE.index("<robot name") + len(LINES[1]):
            assert "was cut off" in told or "is no well-formed" in told or "no well-formed XML" in told, (
                size,
                told,
            )
    names = read(whole).names
    assert [read(whole[:size]).names for size in range(end, len(whole) + 1)] == [names] * (len(whole) - end + 1)


def line_of(text: str) -> int:
    return 1 + next(i for i, line in enumerate(LINES) if text in line)


ELBOW_LIMIT = ('"continuous">', '"revolute"><limit effort="1" velocity="1"/>')
"""What is put in place of what, in one line."""
LIMIT = 'lower="-1.5" upper="2"'
FAULTS = {
    "a circle": ('<parent link="base"/>', '<parent link="hand"/>', ["circle of joints: ", "shoulder", "line 5"]),
    "a circle of one": ('<parent link="base"/>', '<parent link="upper"/>', ["circle of joints: shoulder"]),
    "two parents": (
        '  <link name="hand"/>',
        '<link name="hand"/><joint name="x" type="fixed"><parent link="base"/><child link="hand"/></joint>',
        ["joint x: link hand is also the child of joint flange, line 18"],
    ),
    "two joints of a name": ('name="elbow" type', 'name="shoulder" type', ["joint shoulder: is also in line 4"]),
    "two links of a name": ('<link name="fore"/>', '<link name="upper"/>', ["link upper: is also in line 11"]),
    "a parent that is no link": (
        '<parent link="upper"/>',
        '<parent link="uper"/>',
        ["elbow", "did you mean upper?"],
    ),
    "a child that is no link": ('<child link="fore"/>', '<child link="for"/>', ["elbow", "did you mean fore?"]),
    "no parent": ('    <parent link="upper"/>', "", ['joint elbow: has no <parent link="...">']),
    "no child": ('    <child link="fore"/>', "", ['joint elbow: has no <child link="...">']),
    "a parent without link": ('<parent link="upper"/>', "<parent/>", ['elbow: has no <parent link="...">']),
    "no name of a joint": ('name="elbow" type', "type", ["a joint has no name"]),
    "no name of a link": ('<link name="fore"/>', '<link name=""/>', ["a link has no name"]),
    "several roots": ('  <link name="hand"/>', '<link name="hand"/><link name="x"/>', ["2 links that hang on no"]),
    "a joint in a link": (
        '  <link name="hand"/>',
        '<link name="hand"><joint name="x" type="fixed"><parent link="hand"/><child link="x"/></joint></link>'
        '<link name="x"/>',
        ["2 links that hang on no joint: base, x"],
    ),
    "a zero axis": ('xyz="0 0 2"', 'xyz="0 0 0"', ["joint shoulder: <axis> 0 0 0 is no direction"]),
    "a NaN axis": ('xyz="0 0 2"', 'xyz="0 0 nan"', ["joint shoulder", "needs 3 finite numbers"]),
    "an axis of two numbers": ('xyz="0 0 2"', 'xyz="0 1"', ['<axis> has xyz="0 1"; needs 3 finite numbers']),
    "an axis of four": ('xyz="0 0 2"', 'xyz="0 0 1 0"', ["needs 3 finite numbers"]),
    "an axis with commas": ('xyz="0 0 2"', 'xyz="0,0,1"', ["needs 3 finite numbers"]),
    "an axis too long": ('xyz="0 0 2"', 'xyz="0 0 1e200"', ["is no direction"]),
    "an axis of infinite length": ('xyz="0 0 2"', 'xyz="0 0 1e999"', ["needs 3 finite numbers"]),
    "an axis without numbers": ('<axis xyz="0 0 2"/>', "<axis/>", ["<axis> has no xyz"]),
    "an axis under another name": ('<axis xyz="0 0 2"/>', '<Axis xyz="0 0 2"/>', ["did you mean <axis>?"]),
    "a NaN origin": ('xyz="0 0 0.3"', 'xyz="nan 0 0"', ['joint shoulder: <origin> has xyz="nan 0 0"']),
    "an infinite origin": ('xyz="0 0 0.3"', 'xyz="inf 0 0"', ["needs 3 finite numbers"]),
    "an origin beyond sense": ('xyz="0 0 0.3"', 'xyz="0 0 1e300"', ["within ±1e+06"]),
    "an origin of Python": ('xyz="0 0 0.3"', 'xyz="0 0 1_0"', ["needs 3 finite numbers"]),
    "an origin of other digits": ('xyz="0 0 0.3"', 'xyz="0 0 ١"', ["needs 3 finite numbers"]),
    "a NaN rotation": ('rpy="0 0.5 0"', 'rpy="0 NaN 0"', ['<origin> has rpy="0 NaN 0"']),
    "a rotation of two numbers": ('rpy="0 0.5 0"', 'rpy="0 0.5"', ["needs 3 finite numbers"]),
    "a NaN origin of a fixed joint": ('rpy="0 0 1"', 'rpy="0 0 nan"', ["joint flange", "needs 3 finite"]),
    "an origin of quaternions": ('rpy="0 0.5 0"', 'quat_xyzw="0 0 0 1"', ["attribute quat_xyzw", "rpy, xyz"]),
    "two origins": ('xyz="0.4 0 0"/>', 'xyz="0.4 0 0"/><origin/>', ["elbow", "second <origin>", "line 15"]),
    "limits reversed": (LIMIT, 'lower="2" upper="-1.5"', ["shoulder: <limit> has lower 2 and upper -1.5"]),
    "limits NaN": (LIMIT, 'lower="nan" upper="2"', ['<limit> has lower="nan"', "one finite number", "continuous"]),
    "limits infinite": (LIMIT, 'lower="-inf" upper="inf"', ["one finite number", 'type="continuous"']),
    "one limit endless": (LIMIT, 'lower="-1e16" upper="2"', ["within ±1e+06", 'type="continuous"']),
    "limits equal": (LIMIT, 'lower="0.5" upper="0.5"', ["leaves no range"]),
    "limits empty": (LIMIT, 'lower="" upper=""', ["one finite number"]),
    "no limits": (LIMIT, "", ["leaves no range: lower 0 and upper 0", 'type="continuous"']),
    "no limit element": (*ELBOW_LIMIT, ["elbow", "leaves no range"]),
    "only a negative upper": (LIMIT, 'upper="-1"', ["left out, one is 0"]),
    "a limit misspelt": (LIMIT, 'lower="-1" uper="2"', ["<limit> has no upper, but uper", "did you mean upper?"]),
    "limits misspelt": (f"<limit {LIMIT}", f"<limits {LIMIT}", ["has no <limit>, but <limits>"]),
    "a revolute joint without limit": ('"continuous"', '"revolute"', ["is revolute and has no <limit>"]),
    "a joint that mimics": (
        'xyz="0.4 0 0"/>',
        'xyz="0.4 0 0"/><mimic joint="shoulder" multiplier="2"/>',
        ["joint elbow: mimics joint shoulder", "choose base and tip"],
    ),
    "a floating joint": ('"continuous"', '"floating"', ["joint elbow: is floating; allowed: revolute"]),
    "a planar joint": ('"continuous"', '"planar"', ["is planar"]),
    "a sliding joint": ('"continuous"', '"prismatic"', ["is prismatic"]),
    "a type misspelt": ('"continuous"', '"Revolute"', ["is Revolute; allowed: revolute"]),
    "no type": (' type="continuous"', "", ["joint elbow: has no type"]),
    "a macro": ('  <link name="hand"/>', '<xacro:macro name="m"/>', ["not expanded: <xacro:macro>", "expand it"]),
    "an old macro": ('  <link name="hand"/>', '<macro name="m"/>', ["xacro that is not expanded"]),
    "an expression": ('xyz="0 0 0.3"', 'xyz="0 0 ${height}"', ['xyz="0 0 ${height}"', "expand it first"]),
    "an argument": ('<link name="fore"/>', '<link name="$(arg prefix)fore"/>', ["expand it first"]),
    "a control character": ('name="elbow" type', 'name="el\x01bow" type', ["no well-formed XML"]),
    "a name for terminals": (
        'name="elbow" type="continuous"',
        'name="&#155;31m" type="x"',
        ["joint \\x9b31m: is x"],
    ),
    "an entity": ('xyz="0 0 0.3"', 'xyz="&zero; 0 0"', ["no well-formed XML", "undefined entity"]),
    "an attribute twice": (LIMIT, 'lower="-1" lower="-2"', ["duplicate attribute"]),
    "a tag that is not closed": (
        '<child link="fore"/>',
        '<child link="fore">',
        ["mismatched tag", "no well-formed"],
    ),
    "an ampersand": ('name="two"', 'name="a & b"', ["no well-formed XML"]),
}


@pytest.mark.failure
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_refused_by_line_and_joint(read, fault):
    old, new, said = FAULTS[fault]
    assert WHOLE.count(old) == 1, f"{old} marks no one place"
    told = refusal(read, WHOLE.replace(old, new))
    for words in said:
        assert words in told
    assert re.search(r"line \d+", told) or "links that hang on no joint" in told
    if fault.startswith(("a NaN", "limits", "an axis", "an origin")) and "did you mean" not in told:
        assert f"robot.urdf: line {line_of(old)}: joint " in told


@pytest.mark.parametrize(
    ("limit", "expected"),
    [
        ('upper="2"', [0.0, 2.0]),
        ('lower="-1"', [-1.0, 0.0]),
        ('lower=" -1.5 " upper="+2.5e0"', [-1.5, 2.5]),
        ('lower="-1e16" upper="1e16"', [-pi, pi]),
    ],
)
def test_a_bound_that_is_left_out_is_zero_as_the_format_says(read, limit, expected):
    np.testing.assert_array_equal(read(WHOLE.replace(LIMIT, limit)).ranges[0], expected)


@pytest.mark.failure
@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", ["is empty"]),
        (b"\n \n", ["is empty"]),
        (b"name,position\n1,2\n", ["is no URDF that can be read", "line 1"]),
        (b"PK\x03\x04\x00\x00", ["is no URDF that can be read"]),
        (b"<html><body/></html>", ["its first element is <html>, not <robot>"]),
        (b"<Robot name='r'/>", ["its first element is <Robot>"]),
        (b"<robot name='r'/>", ["has no links"]),
        (b"<sdf version='1.9'><model name='m'/></sdf>", ["is SDF (of Gazebo), not URDF", "[[arm.joints]]"]),
        (b"<mujoco model='m'><worldbody/></mujoco>", ["is MJCF (of MuJoCo), not URDF"]),
        (b"<x:robot xmlns:x='http://ros.org/wiki/xacro'/>", ["is xacro (<x:robot>)", "expand it first"]),
        (WHOLE.encode() + b"<robot/>", ["no well-formed XML", "junk after document element"]),
        (WHOLE.encode().replace(b"<?xml", b" <?xml"), ["no well-formed XML"]),
        (WHOLE.encode().replace(b'"1.0"', b'"1.0" encoding="klingon"'), ["unknown encoding"]),
        (WHOLE.encode() + b"\0", ["no well-formed XML"]),
        (WHOLE.encode().replace(b"elbow", b"\xff"), ["line 12", "within <robot>", "invalid token"]),
        (WHOLE.encode("utf-16")[:-40], ["line"]),
        (b"<robot name='r'>" + 200_000 * b"<a>", ["ends within <a>", "cut off"]),
    ],
)
def test_what_is_no_urdf_is_told_for_what_it_is(read, content, said):
    told = refusal(read, content)
    for words in said:
        assert words in told


@pytest.mark.failure
def test_a_document_that_defines_entities_is_never_followed(read, tmp_path):
    secret = tmp_path / "secret"
    secret.write_text("nobody reads this")
    bomb = "".join(f'<!ENTITY e{i + 1} "{10 * f"&e{i};"}">' for i in range(12))
    for inner in (f'<!ENTITY e0 "0">{bomb}', f'<!ENTITY e12 SYSTEM "file://{secret}">'):
        told = refusal(read, f"<!DOCTYPE robot [{inner}]>\n" + WHOLE.replace(LINES[0], "").replace("two", "&e12;"))
        assert "has a DOCTYPE" in told
        assert "nobody" not in told


def test_encodings_of_xml_are_those_of_xml(read):
    named = WHOLE.replace("elbow", "coude-é")
    for encoding in ("utf-8-sig", "utf-16", "iso-8859-1"):
        own = named.replace('"1.0"', f'"1.0" encoding="{encoding.removesuffix("-sig")}"')
        assert read(own.encode(encoding)).names == ("shoulder", "coude-é")


def test_a_deep_tree_costs_no_recursion(read):
    count = 3000
    links = "".join(f'<link name="l{i}"/>' for i in range(count + 1))
    joints = "".join(
        f'<joint name="j{i}" type="continuous"><parent link="l{i}"/><child link="l{i + 1}"/></joint>'
        for i in range(count)
    )
    assert read(f"<robot name='r'>{links}{joints}</robot>", tip=f"l{count}").joints == count
    told = refusal(read, f"<robot name='r'>{links}{joints.replace('"l0"', f'"l{count}"')}</robot>", tip="l1")
    assert "in a circle of joints" in told
    assert len(told) < 1000


@pytest.mark.failure
def test_a_tip_or_base_that_is_not_there_is_answered_with_those_that_are(read):
    assert "study.toml: arm.tip: got 'Hand'" in (told := refusal(read, WHOLE, tip="Hand"))
    assert "did you mean hand? tips of " in told
    assert told.endswith("robot.urdf: hand, upper, fore")
    assert "arm.tip: is missing; needs the name of the hand's link" in refusal(read, WHOLE, tip=None)
    assert "study.toml: arm.base: got 'Base', which is no link" in (told := refusal(read, WHOLE, base="Base"))
    assert told.endswith("did you mean base? links above hand: fore, upper, base")
    assert "got 'hand', which is not above 'fore'" in refusal(read, WHOLE, tip="fore", base="hand")
    assert "has no moving joint between" in refusal(read, WHOLE, tip="hand", base="fore")
    rigid = WHOLE.replace("continuous", "fixed").replace("revolute", "fixed")
    assert "has no moving joint" in refusal(read, rigid, tip="Hand")


@pytest.mark.failure
def test_mistakes_of_a_chain_are_told_together(read):
    bad = WHOLE.replace('xyz="0 0 2"', 'xyz="0 1"').replace(LIMIT, "").replace('xyz="0.4 0 0"', 'xyz="nan 0 0"')
    told = refusal(read, bad)
    assert [line.split(": ")[1] for line in told.splitlines()[::2]] == ["line 8", "line 9", "line 15"]


@pytest.mark.failure
def test_a_mistake_is_told_once(read):
    told = refusal(read, WHOLE.replace(LIMIT, 'lower="nan" upper="0"'))
    assert told.count("<limit>") == 1


@pytest.mark.failure
def test_a_file_that_is_not_there_or_too_large_is_named(tmp_path, monkeypatch):
    (tmp_path / "robot.urdf").write_text(WHOLE)
    for name, said in (("robo.urdf", "did you mean robot.urdf?"), (".", "is a folder"), ("a\0b", "no such file")):
        with pytest.raises(InputError, match=re.escape(said)):
            read_chain(tmp_path / name, None, "hand", "study.toml: arm")
    monkeypatch.setattr(urdf_xml, "_LARGEST", 1e-6)
    with pytest.raises(InputError, match="at most 1e-06 MB are read"):
        read_chain(Path(tmp_path / "robot.urdf"), None, "hand", "study.toml: arm")
