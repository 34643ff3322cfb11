"""The stiffness design of an arm leaves the lab as what the lab itself computes."""

from __future__ import annotations

import json
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.tuning.exports.native import needs_compiler
from tuning.exports.deployable import deployable_of
from tuning.exports.golden import assembled
from tuning.exports.ranges import Range
from tuning.files.shipped import CONFIGS
from tuning.kinds.arm.bench import build_bench
from tuning.kinds.arm.study import load_arm_study
from vsajax.compliance import ArmReading, CartesianImpedance, Status
from vsajax.compliance.online import displacement

ARM = CONFIGS / "studies" / "arm.toml"
TARGETS = ["toml", "json", "c99", "fmi2", "fmi3", "ros2", "mat", "stablehlo"]
SEVEN = (
    *("arm={preset='lwr-like-7'}", "joints={lower=50.0, upper=500.0}", "task.space='pose'"),
    "task.stiffness=[500.0, 500.0, 500.0, 50.0, 50.0, 50.0]",
)


@pytest.fixture(autouse=True)
def _path(monkeypatch, request):
    # The checks run in processes of their own, on the packages of this checkout.
    monkeypatch.setenv("PYTHONPATH", str(request.config.rootpath))


def words(settings):
    return [word for setting in settings for word in ("--set", setting)]


def test_a_cycle_is_the_design_of_the_lab_and_the_controller_of_the_loop():
    study = load_arm_study(ARM)
    problem = build_bench(study, ARM)
    controller = deployable_of(study, str(ARM)).module
    rng = np.random.default_rng(2)
    position, velocity, posture = (jnp.asarray(rng.normal(size=4) * scale) for scale in (0.5, 0.3, 0.5))
    reading = ArmReading(position, velocity, posture, jnp.asarray(study.task.matrix()))

    def both(problem, controller, reading):
        design = problem.design(reading.position)
        at_posture = CartesianImpedance(problem.arm, design.active_stiffness, reading.position).damped(0.7, 0.5)
        moved = eqx.tree_at(lambda c: c.posture, at_posture, reading.posture)
        return controller.step((), reading)[1], design, moved.torque(reading.position, reading.velocity)

    command, design, torque = eqx.filter_jit(both)(problem, controller, reading)
    for ours, theirs in (
        (command.joint_stiffness, design.joint_stiffness),
        (command.active_stiffness, design.active_stiffness),
    ):
        np.testing.assert_allclose(ours, theirs, rtol=1e-12)
    # The cycle has a ridge, which the loop has not.
    np.testing.assert_allclose(command.torque, torque, rtol=1e-9)
    assert int(command.status) == int(design.status) == Status.SOLVED


def test_a_small_rotation_is_its_vector():
    problem = build_bench(load_arm_study(ARM), ARM)
    position, turn = jnp.array([0.4, -0.3, 0.2, 0.9]), 1e-6 * jnp.array([1.0, -2.0, 0.5, 1.5])
    arm = problem.arm
    moved = displacement(arm.forward(position + turn), arm.forward(position))
    np.testing.assert_allclose(moved, arm.jacobian(position) @ turn, atol=1e-11)


@pytest.mark.slow(
    twin=(
        "test_a_cycle_is_the_design_of_the_lab_and_the_controller_of_the_loop",
        "tests/vsajax/compliance/test_stiffness_design.py::test_what_has_no_answer_says_so",
    )
)
def test_the_golden_path_meets_bounds_a_singular_pose_and_refusals():
    deployable = deployable_of(load_arm_study(ARM), str(ARM))
    columns, _ = deployable.simulate(4.0)
    names = ArmReading._fields
    readings = ArmReading(*(jnp.asarray(columns[name]) for name in names))
    module = deployable.module
    commands = jax.jit(jax.vmap(lambda reading: module.step((), reading)[1]))(readings)
    jacobians = jax.vmap(lambda q: module.jacobian(q, 3))(readings.position)
    spread = np.linalg.svd(np.asarray(jacobians), compute_uv=False)
    assert (spread[:, -1] / spread[:, 0]).min() < 1e-2
    lower, upper = (np.asarray(bound) for bound in module.bounds)
    stiffness = np.asarray(commands.joint_stiffness)[:-4]
    assert np.isclose(stiffness, upper).any()
    assert np.isclose(stiffness, lower).any()
    assert not np.isclose(stiffness, lower).all(0).any()
    assert [Status(int(s)) for s in commands.status[-4:]] == [
        *(Status.NOT_DEFINITE, Status.NOT_FINITE, Status.UNREACHABLE, Status.SOLVED),
    ]
    assert np.isnan(np.asarray(commands.torque)[-4:-2]).all()


def test_joints_with_names_are_named_in_the_order_of_the_arrays():
    panda = Path(__file__).parents[2] / "golden" / "panda" / "panda.urdf"
    settings = [f"arm={{urdf='{panda}', tip='panda_link4'}}", "joints={lower=50.0, upper=500.0}"]
    named = deployable_of(load_arm_study(ARM, settings), str(ARM)).title
    assert "an arm with 4 joints (panda_joint1, panda_joint2, panda_joint3, panda_joint4, in this order)" in named
    assert "an arm with 4 joints, in every cycle" in deployable_of(load_arm_study(ARM), str(ARM)).title


def test_ranges_are_those_of_the_study_file():
    deployable = deployable_of(load_arm_study(ARM), str(ARM))
    assert deployable.range(("bounds", "lower")) == Range(1e-6, 1e9)
    assert deployable.range(("damping_ratio",)) == Range(0.0, 1e6)
    assert deployable.range(("arm", "offsets")) == Range(-1e3, 1e3)


@pytest.mark.slow(twin="tests/tuning/exports/test_families.py::test_every_format_of_every_family_holds")
@needs_compiler
@pytest.mark.cli
def test_an_arm_is_exported_and_checked(vsajax, tmp_path):
    ended = vsajax("export", ARM, "--to", "c99", "-o", tmp_path, "--duration", "1.0")
    assert (ended.code, ended.err) == (0, ""), ended
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    assert (manifest["what"], manifest["kind"], manifest["sample_time_s"]) == ("designer", "arm", None)
    assert [(row["name"], row["shape"]) for row in manifest["inputs"]] == [
        *(("position", [4]), ("velocity", [4]), ("posture", [4]), ("stiffness", [3, 3])),
    ]
    assert {row["name"]: row["type"] for row in manifest["outputs"]}["status"] == "int"
    assert manifest["state_bytes"] == {"double": 0, "single": 0}
    # The turns of the interior point and of the rotations are counted.
    assert manifest["worst_case_operations"]["div"] > 500
    source = (tmp_path / "hand_arm.c").read_text()
    assert "for (int turn = 0; turn < 20; ++turn) {" in source
    assert len(source.splitlines()) < 4000
    assert {check["state"] for check in manifest["checks"]} == {"passed"}
    twice = vsajax("export", ARM, "--to", "mat", "-o", tmp_path / "mat", "--recording", tmp_path / "golden.csv")
    assert twice.code == 2
    assert "an arm is not recorded joint by joint" in twice.err


@needs_compiler
@pytest.mark.cli
@pytest.mark.equivalence
@pytest.mark.slow(twin="tests/tuning/exports/test_families.py::test_every_format_of_every_family_holds")
@pytest.mark.parametrize("target", TARGETS)
def test_every_format_of_a_seven_joint_arm_holds(vsajax, target, tmp_path):
    ended = vsajax("export", ARM, "--to", target, "-o", tmp_path, "--check", *words(SEVEN))
    assert (ended.code, ended.err) == (0, ""), ended
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    states = {check["name"]: check["state"] for check in manifest["checks"]}
    assert "failed" not in states.values(), manifest["checks"]
    assert manifest["golden"]["samples"] == 1001
    if target == "c99":
        time = next(check for check in manifest["checks"] if check["name"] == "step time")
        assert time["figures"]["nanoseconds"] < 100e3


def test_numbers_and_arrays_are_one_another():
    program = deployable_of(load_arm_study(ARM), str(ARM)).program()
    rng = np.random.default_rng(1)
    numbers = {
        f"{name}{''.join(f'[{i}]' for i in index)}": rng.normal(size=5)
        for name, leaf in (
            (name, leaf) for name, (_, leaf) in zip(program.inputs.names, program.inputs.places, strict=True)
        )
        for index in np.ndindex(*leaf.shape)
    }
    arrays = assembled(program.inputs, numbers)
    assert arrays["stiffness"].shape == (5, 3, 3)
    assert np.array_equal(arrays["stiffness"][:, 1, 2], numbers["stiffness[1][2]"])
