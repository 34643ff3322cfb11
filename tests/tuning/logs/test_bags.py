"""ROS bags as robots record them: named elements, several publishers, types without definitions, lost files."""

from __future__ import annotations

import contextlib
import shutil
from pathlib import Path

import numpy as np
import pytest

from tuning.files.errors import InputError
from tuning.logs.formats import read_streams
from tuning.logs.guess import propose, to_map
from tuning.logs.reading import read_recording

rosbag2 = pytest.importorskip("rosbags.rosbag2")

TIME = 0.005 * np.arange(60)
ANGLE = 0.02 * np.sin(30.0 * TIME)
MOTOR = 0.5 * np.sin(20.0 * TIME)
TORQUE = 120.0 * ANGLE
START = 1_700_000_000_000_000_000


def store():
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)


def state(names, position, effort=(), *, stamp: int = 0, frame: str = ""):
    types = store().types
    time = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    return types["sensor_msgs/msg/JointState"](
        header=types["std_msgs/msg/Header"](stamp=time, frame_id=frame),
        name=list(names),
        position=np.array(position, np.float64),
        velocity=np.array([]),
        effort=np.array(effort, np.float64),
    )


def write_bag(folder: Path, messages, *, plugin: str = "MCAP", mode=None) -> Path:
    """Write a bag of (topic, when [s], message)."""
    path = folder / "bag"
    shutil.rmtree(path, ignore_errors=True)
    types = store()
    writer = rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin[plugin])
    if mode is not None:
        writer.set_compression(mode, rosbag2.CompressionFormat.ZSTD)
    with writer:
        topics = {
            topic: writer.add_connection(topic, message.__msgtype__, typestore=types)
            for topic, message in {topic: message for topic, _, message in messages}.items()
        }
        for topic, when, message in messages:
            raw = types.serialize_cdr(message, message.__msgtype__)
            writer.write(topics[topic], START + round(1e9 * when), raw)
    return path


def joint(*, stamped: bool = True, names=("motor", "link"), gripper: bool = False, second: bool = False):
    """Return the messages of one topic: the joint's, and between them a gripper's or a second publisher's."""
    found = []
    for t, angle, motor, torque in zip(TIME, ANGLE, MOTOR, TORQUE, strict=True):
        stamp = START + round(1e9 * t) if stamped else 0
        late = stamp + 2_000_000 if stamped else 0
        found.append(("/joint_states", t, state(names, [motor, motor + angle], [0.0, torque], stamp=stamp)))
        if gripper:
            found.append(("/joint_states", t + 0.002, state(["finger"], [0.1], [2.0], stamp=late)))
        if second:
            found.append(("/joint_states", t + 0.002, state(names, [motor, motor], stamp=late)))
    return found


MAP = """
schema_version = 1
kind = "sea"
[clock]
column = "/joint_states/{clock}"
unit = "ns"
{select}
[signals.link_position]
column = "/joint_states/position[link]"
unit = "rad"
[signals.motor_position]
column = "/joint_states/position[motor]"
unit = "rad"
[signals.elastic_torque]
column = "{torque}"
unit = "N.m"
"""


def read(bag: Path, *, clock="header.stamp", select="", torque="/joint_states/effort[link]"):
    path = bag.parent / "map.toml"
    path.write_text(MAP.format(clock=clock, select=select, torque=torque))
    return read_recording(bag, path)


def holds(table) -> None:
    np.testing.assert_allclose(table.columns["time"], TIME, atol=1e-12)
    turned = table.columns["link_position"] - table.columns["motor_position"]
    np.testing.assert_allclose(turned, ANGLE, atol=1e-15)
    np.testing.assert_allclose(table.columns["elastic_torque"], TORQUE, rtol=1e-15)


@pytest.mark.parametrize("names", [("motor", "link"), ("elbow_motor_joint", "elbow_link_joint")])
def test_the_names_of_elements_say_which_side_of_the_spring_they_are(tmp_path, names):
    proposal = propose(write_bag(tmp_path, joint(names=names)))
    found = {guess.name: guess.column for guess in proposal.guesses}
    assert found["motor_position"] == f"/joint_states/position[{names[0]}]"
    assert found["link_position"] == f"/joint_states/position[{names[1]}]"
    assert found["elastic_torque"] == f"/joint_states/effort[{names[1]}]"


def test_messages_without_the_mapped_elements_are_left_out_and_counted(tmp_path):
    bag = write_bag(tmp_path, joint(gripper=True))
    table = read(bag)
    holds(table)
    assert any("60 of 120 messages of /joint_states left out: they are without" in note for note in table.notes)
    (tmp_path / "proposed.toml").write_text(to_map(propose(bag), bag))
    holds(read_recording(bag, tmp_path / "proposed.toml"))


def test_two_publishers_on_a_topic_are_told_apart_by_what_is_mapped_or_by_select(tmp_path):
    bag = write_bag(tmp_path, joint(second=True))
    # Only one of them has the torque.
    holds(read(bag))
    types = store().types
    wrench = [
        ("/ft", t, types["std_msgs/msg/Float64"](data=float(torque)))
        for t, torque in zip(TIME, TORQUE, strict=True)
    ]
    bag = write_bag(tmp_path, [*joint(second=True), *wrench])
    with pytest.raises(InputError, match=r"2 publishers with .*position\[link\]") as caught:
        read(bag, clock="received", torque="/ft/data")
    fix = caught.value.mistakes[0].fix
    assert any("several publishers" in note for note in propose(bag).notes)
    assert '"/joint_states/publisher" = "motor link; position effort"' in fix
    select = '[select]\n"/joint_states/publisher" = "motor link; position effort"'
    holds(read(bag, clock="received", torque="/ft/data", select=select))
    with pytest.raises(InputError, match="no message has"):
        read(bag, select='[select]\n"/joint_states/publisher" = "motor link; position"')


@pytest.mark.failure
def test_stamps_that_were_never_filled_name_the_received_ones(tmp_path):
    bag = write_bag(tmp_path, joint(stamped=False))
    with pytest.raises(InputError, match=r"its clock never ran; set clock\.column to /joint_states/received"):
        read(bag)
    holds(read(bag, clock="received"))
    assert propose(bag).clock[0] == "/joint_states/received"


def without_definition(bag: Path, old: bytes, new: bytes) -> None:
    """Give a type of a bag in SQLite, which has no definitions, another name of the same length."""
    import sqlite3

    file = next(bag.glob("*.db3"))
    with contextlib.closing(sqlite3.connect(file)) as base, base:
        base.execute("UPDATE topics SET type = replace(type, ?, ?)", (old.decode(), new.decode()))
        base.execute("DELETE FROM message_definitions")
    metadata = bag / "metadata.yaml"
    metadata.write_bytes(metadata.read_bytes().replace(old, new))


@pytest.mark.failure
@pytest.mark.parametrize("as_file", [False, True])
def test_a_type_without_a_definition_is_named(tmp_path, as_file):
    bag = write_bag(tmp_path, joint(), plugin="SQLITE3")
    without_definition(bag, b"sensor_msgs/msg/JointState", b"my_msgs/msg/JointStateOurs")
    place = next(bag.glob("*.db3")) if as_file else bag
    with pytest.raises(InputError, match=r"no topic whose type is known: /joint_states \(my_msgs/msg/JointState"):
        read_streams(place)
    types = store().types
    extra = [("/ft", t, types["std_msgs/msg/Float64"](data=1.0)) for t in TIME]
    bag = write_bag(tmp_path, [*joint(), *extra], plugin="SQLITE3")
    without_definition(bag, b"sensor_msgs/msg/JointState", b"my_msgs/msg/JointStateOurs")
    with pytest.raises(InputError, match=r"topic /joint_states is there, but .* definition of my_msgs/msg/Joint"):
        read(next(bag.glob("*.db3")) if as_file else bag)
    assert any("topic /joint_states is not read" in note for note in propose(bag).notes)


def test_a_folder_without_metadata_is_read_file_by_file_and_said(tmp_path):
    for plugin in ("MCAP", "SQLITE3"):
        bag = write_bag(tmp_path, joint(), plugin=plugin)
        (bag / "metadata.yaml").unlink()
        table = read(bag)
        holds(table)
        assert any("no metadata.yaml" in note for note in table.notes)
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="is a directory"):
        read_streams(tmp_path / "empty")


@pytest.mark.failure
def test_a_file_of_messages_compressed_one_by_one_names_its_folder(tmp_path):
    bag = write_bag(tmp_path, joint(), mode=rosbag2.CompressionMode.MESSAGE)
    holds(read(bag))
    file = next(bag.glob("*.mcap"))
    with pytest.raises(InputError, match=r"compressed one by one (?s:.*)fix: give the folder: .*bag"):
        read_streams(file)
    (bag / "metadata.yaml").unlink()
    with pytest.raises(InputError, match=r"compressed one by one (?s:.*)ros2 bag reindex"):
        read_streams(bag)


@pytest.mark.failure
def test_a_name_that_is_not_utf8_in_hdf5_is_named(tmp_path, vsajax):
    h5py = pytest.importorskip("h5py")
    for suffix in (".h5", ".mat"):
        path = tmp_path / f"log{suffix}"
        with h5py.File(path, "w") as file:
            for name in (b"time", b"torque\xff"):
                file[name] = TIME
        ended = vsajax("init", "map", path, "-o", tmp_path / "map.toml")
        assert (ended.code, ended.out) == (2, "")
        assert r"torque\xff" in ended.err
        assert "not UTF-8" in ended.err
        assert not (tmp_path / "map.toml").exists()
