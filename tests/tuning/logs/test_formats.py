"""One recording through every format, files beside files, other clocks, and what damaged or odd files say."""

from __future__ import annotations

import shutil
import sys

import numpy as np
import pytest
from scipy.io import savemat

from tuning.files.errors import InputError
from tuning.logs.formats import read_streams
from tuning.logs.reading import read_recording

TIME = np.round(0.002 * np.arange(200), 6)
ANGLE = 0.05 * np.sin(9.0 * TIME)
TORQUE = 60.0 * ANGLE + 0.2

HEAD = 'schema_version = 1\nkind = "sea"\n{join}\n[clock]\ncolumn = "{clock}"\nunit = "{unit}"\n{more}\n'
SIGNAL = '[signals.{name}]\ncolumn = "{column}"\nunit = "{unit}"\n{more}\n'


def write_map(folder, clock, deflection, torque, *, unit="s", more="", join="", own="", torque_unit="N.m"):
    path = folder / "map.toml"
    path.write_text(
        HEAD.format(join=join, clock=clock, unit=unit, more=more)
        + SIGNAL.format(name="deflection", column=deflection, unit="rad", more=own)
        + SIGNAL.format(name="elastic_torque", column=torque, unit=torque_unit, more="")
    )
    return path


def holds(table, *, atol=0.0):
    np.testing.assert_allclose(table.columns["time"], TIME, atol=1e-12)
    np.testing.assert_allclose(table.columns["deflection"], ANGLE, rtol=1e-15, atol=atol)
    np.testing.assert_allclose(table.columns["elastic_torque"], TORQUE, rtol=1e-15, atol=atol)


@pytest.mark.parametrize("version", ["5", "4"])
def test_matlab_matrices_and_structs(tmp_path, version):
    path = tmp_path / "log.mat"
    savemat(path, {"t": TIME, "data": np.stack([ANGLE, TORQUE], axis=1), "note": "hello"}, format=version)
    holds(read_recording(path, write_map(tmp_path, "t", "data(:,1)", "data(:,2)")))
    if version == "5":
        savemat(path, {"log": {"t": TIME, "q": {"phi": ANGLE}, "wide": np.stack([TIME, TORQUE])}})
        holds(read_recording(path, write_map(tmp_path, "log.t", "log.q.phi", "log.wide(2,:)")))


def test_matlab_7_3_is_hdf5_under_matlabs_names(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "log.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["data"] = np.stack([ANGLE, TORQUE])
        file["data"].attrs["MATLAB_class"] = b"double"
        file["log/t"] = TIME[None]
        file["#refs#/a"] = TIME
    holds(read_recording(path, write_map(tmp_path, "log.t", "data(:,1)", "data(:,2)")))


def test_hdf5_datasets_matrices_and_compound_types(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "log.h5"
    with h5py.File(path, "w") as file:
        file["run/t"] = TIME
        file["run/both"] = np.stack([ANGLE, TORQUE], axis=1)
        file["table"] = np.rec.fromarrays([TIME, ANGLE, TORQUE], names="t,phi,tau")
    holds(read_recording(path, write_map(tmp_path, "run/t", "run/both[:,0]", "run/both[:,1]")))
    holds(read_recording(path, write_map(tmp_path, "table.t", "table.phi", "table.tau")))


def write_bag(folder, plugin: str, *, late: float = 0.0):
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    make = {name.rsplit("/", 1)[-1]: store.types[name] for name in store.types}
    path = folder / "bag"
    shutil.rmtree(path, ignore_errors=True)
    with rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin[plugin]) as writer:
        joints = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        wrench = writer.add_connection("/ft", "geometry_msgs/msg/WrenchStamped", typestore=store)
        for t, angle, torque in zip(TIME, ANGLE, TORQUE, strict=True):

            def header(shift: float = 0.0, t: float = float(t)):
                stamp = 1_700_000_000_000_000_000 + round(1e9 * (t + shift))
                time = make["Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
                return stamp, make["Header"](stamp=time, frame_id="")

            stamp, head = header()
            state = make["JointState"](
                header=head,
                name=["shoulder", "elbow"],
                position=np.array([9.0, angle]),
                velocity=np.array([]),
                effort=np.zeros(2),
            )
            writer.write(joints, stamp + 5000, store.serialize_cdr(state, joints.msgtype))
            stamp, head = header(late)
            zero, about = make["Vector3"](x=0.0, y=0.0, z=0.0), make["Vector3"](x=0.0, y=0.0, z=float(torque))
            message = make["WrenchStamped"](header=head, wrench=make["Wrench"](force=zero, torque=about))
            writer.write(wrench, stamp + 9000, store.serialize_cdr(message, wrench.msgtype))
    return path


BAG = ("/joint_states/header.stamp", "/joint_states/position[elbow]", "/ft/wrench.torque.z")


@pytest.mark.parametrize("plugin", ["SQLITE3", "MCAP"])
def test_bags_as_folders_and_as_files(tmp_path, plugin):
    bag = write_bag(tmp_path, plugin)
    signal_map = write_map(tmp_path, *BAG, unit="ns")
    holds(read_recording(bag, signal_map))
    file = next(f for f in bag.iterdir() if f.suffix in (".db3", ".mcap"))
    holds(read_recording(file, signal_map))


def test_topics_of_other_instants_are_joined_only_when_asked(tmp_path):
    bag = write_bag(tmp_path, "MCAP", late=0.0005)
    with pytest.raises(InputError, match=r"(?s)elastic_torque: is sampled at other instants.*clock\.resample"):
        read_recording(bag, write_map(tmp_path, *BAG, unit="ns"))
    table = read_recording(bag, write_map(tmp_path, *BAG, unit="ns", more='resample = "linear"'))
    assert any("samples cut off" in note for note in table.notes)
    time = table.columns["time"]
    # Linear between samples 2 ms apart of a sine of 9 rad/s: off by (ωh)²/8.
    expected = np.interp(time, TIME + 0.0005, TORQUE)
    np.testing.assert_allclose(table.columns["elastic_torque"], expected, atol=1e-6)
    held = read_recording(bag, write_map(tmp_path, *BAG, unit="ns", more='resample = "previous"'))
    assert set(held.columns["elastic_torque"]) <= set(TORQUE)


def test_files_beside_one_another_are_one_recording(tmp_path):
    savemat(tmp_path / "angle.mat", {"a": np.stack([TIME, ANGLE], 1)})
    savemat(tmp_path / "torque.mat", {"b": np.stack([TIME, TORQUE], 1)})
    (tmp_path / "map.toml").write_text(
        HEAD.format(join='join = ["torque.mat"]', clock="a(:,1)", unit="s", more="")
        + SIGNAL.format(name="deflection", column="a(:,2)", unit="rad", more="")
        + SIGNAL.format(name="elastic_torque", column="b(:,2)", unit="N.m", more='clock = "b(:,1)"')
    )
    holds(read_recording(tmp_path / "angle.mat", tmp_path / "map.toml"))
    (tmp_path / "torque.mat").unlink()
    with pytest.raises(InputError, match=r"torque\.mat: no such file"):
        read_recording(tmp_path / "angle.mat", tmp_path / "map.toml")


def test_a_regular_clock_is_made_when_asked(tmp_path):
    rng = np.random.default_rng(0)
    time = np.cumsum(rng.uniform(1e-3, 3e-3, 2000))
    time[1000:] += 0.3
    rows = np.stack([time, np.sin(5 * time), 60 * np.sin(5 * time)], 1)
    savemat(tmp_path / "log.mat", {"d": rows})
    more = 'resample = "linear"\nsample_time = 0.002'
    table = read_recording(tmp_path / "log.mat", write_map(tmp_path, "d(:,1)", "d(:,2)", "d(:,3)", more=more))
    np.testing.assert_allclose(np.diff(table.columns["time"]), 0.002, atol=1e-12)
    assert any(note.startswith("resampled to ") for note in table.notes)
    assert any("made up by interpolation" in note for note in table.notes)
    assert table.clock.gaps[0].length == pytest.approx(0.3, abs=4e-3)


@pytest.mark.failure
@pytest.mark.parametrize("suffix", [".mat", ".h5", ".mcap", ".db3", ".bag"])
@pytest.mark.parametrize("content", [b"", b"not such a file", b"MATLAB 5.0 MAT-file" + bytes(200)])
def test_damaged_files_are_named(tmp_path, suffix, content):
    path = tmp_path / f"log{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"log\.") as caught:
        read_streams(path)
    assert caught.value.mistakes[0].fix


@pytest.mark.failure
def test_a_package_that_is_not_there_is_named_with_the_way_to_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    monkeypatch.delitem(sys.modules, "tuning.logs.bags", raising=False)
    path = tmp_path / "log.mcap"
    path.write_bytes(b"x")
    with pytest.raises(InputError, match=r"(?s)needs the package rosbags to be.*pip install 'vsajax\[logs\]'"):
        read_streams(path)


@pytest.mark.failure
def test_columns_that_do_not_share_rows_need_stamps_of_their_own(tmp_path):
    savemat(tmp_path / "log.mat", {"t": TIME, "phi": ANGLE, "tau": TORQUE[:-7]})
    with pytest.raises(InputError, match=r"signals\.elastic_torque\.clock.*\(193 and 200 rows\)"):
        read_recording(tmp_path / "log.mat", write_map(tmp_path, "t", "phi", "tau"))


@pytest.mark.failure
def test_an_unknown_format_lists_what_is_known(tmp_path):
    (tmp_path / "log.xlsx").write_bytes(b"x")
    with pytest.raises(InputError, match=r"unknown suffix '\.xlsx'; known are \.csv, .*\.parquet, \.mat, \.h5"):
        read_streams(tmp_path / "log.xlsx")
