"""The controller of a damping study leaves the lab as the one that was in the loop."""

from __future__ import annotations

import json

import jax.numpy as jnp
import numpy as np
import pytest

from tests.tuning.exports.native import answers_of, needs_compiler, replay
from tuning.exports.checks.checking import deviation
from tuning.exports.deployable import deployable_of
from tuning.exports.golden import make_golden
from tuning.exports.ranges import Range, range_of
from tuning.files.shipped import CONFIGS
from tuning.files.toml import read_toml
from tuning.kinds.damping.problem import simulate_exchange
from tuning.kinds.damping.study import DampingStudy
from tuning.study.base import resolved, study_hash
from tuning.study.loading import load_config, parse_study
from vsajax import Guarded, Sample

DAMPING = CONFIGS / "studies" / "damping.toml"
ENDS = {"soft": 0.3, "stiff": 1.0}
RULES = {
    "conic": {"type": "conic", "lead": 0.03, "slope": 2.0},
    "lead": {"type": "lead", "position_lead": 0.02, "velocity_lead": 0.03},
    "thresholds": {"type": "thresholds", "position": 0.02, "velocity": 0.3, "falls_back": True},
    "relative": {"type": "relative", "position_share": 0.1, "velocity_share": 0.2},
    "release": {"type": "release", "share": 0.3},
}
CONTROLLERS = {
    "smooth": {"type": "smooth", "sharpness": 5.0, "rate": 14.0, **ENDS},
    "constant": {"type": "constant", "stiffness": 0.5},
    "pid": {"type": "pid", "stiffness": 0.5, "proportional": 0.1, "integral": 0.5, "derivative": 0.05},
    "combined": {
        "type": "combined",
        "stiffness": {"type": "smooth", "sharpness": 5.0, "rate": 14.0, **ENDS},
        "motor": {"proportional": 0.1, "integral": 0.5, "derivative": 0.05},
    },
    "bang_bang": {"type": "bang_bang", "stiffness": 0.5, "return_time": 0.4, "tolerance": 0.1},
    "hold": {"type": "switch", "hold": {"product": 0.01, "position": 0.01, "velocity": 0.05}, **ENDS},
    **{f"switch by {name}": {"type": "switch", "rule": rule, **ENDS} for name, rule in RULES.items()},
}
BRIEF = {"smooth", "bang_bang", "switch by release"}
MOTOR = {"time_constant": 0.02, "top_speed": 10.0}


def study_of(controller: dict, seconds: float = 1.0) -> DampingStudy:
    """Return the shipped study with another controller, and with a motor where the controller moves it."""
    tables = read_toml(DAMPING) | {"controller": controller, "population": {}, "sweep": {}, "tune": {}}
    tables["clock"] = {"sample_time": 1e-3, "duration": seconds}
    if controller["type"] in {"pid", "bang_bang", "combined"}:
        tables["plant"] = tables["plant"] | {"motor": MOTOR}
    study = parse_study(tables, "a test")
    assert isinstance(study, DampingStudy)
    return study


@needs_compiler
@pytest.mark.equivalence
@pytest.mark.parametrize(
    "name", [name if name in BRIEF else pytest.param(name, marks=pytest.mark.slow) for name in CONTROLLERS]
)
def test_c_commands_what_the_controller_in_the_loop_did(name, tmp_path):
    study = study_of(CONTROLLERS[name])
    deployable = deployable_of(study, "a test")
    program = deployable.program()
    golden = make_golden(deployable, program, seconds=1.0, recording=None)
    assert len(golden.time) == 1001
    looped = simulate_exchange(study, 0)
    assert np.array_equal(golden.inputs["link_position"], looped.recording.link_position)
    assert np.array_equal(golden.inputs["motor_position"], looped.recording.motor_position)
    commands = {signal: golden.outputs[signal] for signal in ("stiffness", "motor_position")}
    for signal, commanded in commands.items():
        assert deviation(commanded.tolist(), np.asarray(getattr(looped.commands, signal)).tolist()) < 1e-9, signal
    assert not golden.outputs["held"].any()
    # Commands that never change could be equal for a wrong reason.
    assert max(np.ptp(values) for values in commands.values()) > 0.05 or name == "constant"
    worst = replay(program, golden, tmp_path, "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    assert max(worst.values()) < 1e-9, worst


@needs_compiler
@pytest.mark.equivalence
@pytest.mark.parametrize("name", ["damping_combined", pytest.param("damping_smooth", marks=pytest.mark.slow)])
def test_a_tuned_controller_of_the_repository_runs_in_c_as_in_the_loop(name, tmp_path):
    study = load_config(CONFIGS / "tuned" / f"{name}.toml")
    deployable = deployable_of(study, name)
    program = deployable.program()
    golden = make_golden(deployable, program, seconds=0.5, recording=None)
    assert np.ptp(golden.outputs["stiffness"]) > 0.2
    assert (np.ptp(golden.outputs["motor_position"]) > 0.1) == (name == "damping_combined")
    worst = replay(program, golden, tmp_path)
    assert max(worst.values()) < 1e-9, worst


@needs_compiler
@pytest.mark.equivalence
def test_a_controller_is_not_bound_to_its_sample_time(tmp_path):
    deployable = deployable_of(study_of(CONTROLLERS["smooth"]), "a test")
    program, module = deployable.program(), Guarded(deployable.module)
    rng = np.random.default_rng(1)
    steps = np.concatenate([[0.0], rng.uniform(1e-4, 5e-3, 300)])
    readings = 0.5 * np.sin(13.0 * np.cumsum(steps))
    samples = Sample(*map(jnp.asarray, (steps, readings, 0.1 * readings)))
    golden = answers_of(program, module, lambda m, s, u: m.step(s, u), lambda m, u: m.init(u), samples)
    assert max(replay(program, golden, tmp_path).values()) < 1e-12


def test_ranges_lead_through_controller_and_observer():
    parts = deployable_of(load_config(DAMPING), "a test").parts
    assert range_of(parts, ("controller", "floor")) == Range(0.0, None, False, False)
    assert range_of(parts, ("controller", "conic", "lead")) == Range()
    assert range_of(parts, ("observer", "cutoff")) == Range(0.0, None, True, False)


@needs_compiler
@pytest.mark.cli
def test_a_damping_study_is_exported_and_checked(vsajax, tmp_path, monkeypatch, request):
    monkeypatch.setenv("PYTHONPATH", str(request.config.rootpath))
    ended = vsajax("export", DAMPING, "--to", "c99", "-o", tmp_path, "--duration", "0.3")
    assert (ended.code, ended.err) == (0, ""), ended
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    assert (manifest["what"], manifest["kind"]) == ("controller", "damping")
    assert manifest["study_hash"] == study_hash(load_config(DAMPING))
    assert manifest["sample_time_s"] == 1e-3
    assert manifest["needs_regular_clock"] is False
    assert [row["name"] for row in manifest["inputs"]] == ["dt", "link_position", "motor_position"]
    assert [(row["name"], row["unit"]) for row in manifest["outputs"]] == [
        ("stiffness", "N·m/rad"),
        ("motor_position", "rad"),
        ("held", ""),
        ("skipped", ""),
    ]
    tables = resolved(load_config(DAMPING))
    for row in manifest["parameters"]:
        value = tables
        for key in row["name"].split("."):
            value = value[key]
        assert row["default"] == value, row["name"]
    assert {row["name"] for row in manifest["parameters"]} >= {"observer.cutoff", "controller.conic.lead"}
    assert "passed" in {check["state"] for check in manifest["checks"]}


@pytest.mark.cli
@pytest.mark.failure
def test_what_no_robot_can_run_is_refused(vsajax, tmp_path):
    blind = tmp_path / "blind.toml"
    text = DAMPING.read_text(encoding="utf-8")
    cut = text.index("[sensor]"), text.index("[observer]")
    text = text[: cut[0]] + text[cut[1] :]
    blind.write_text("\n".join(line for line in text.splitlines() if not line.startswith('"sensor.')))
    ended = vsajax("export", blind, "--to", "c99", "-o", tmp_path / "out")
    assert (ended.code, ended.out) == (2, "")
    assert "blind.toml: sensor: is missing: the controller was given the true motion" in ended.err
    odd = tmp_path / "odd.toml"
    odd.write_text((CONFIGS / "tuned" / "sea_sensor.toml").read_text().replace('kind = "sea"', 'kind = "damping"'))
    ended = vsajax("export", odd, "--to", "c99", "-o", tmp_path / "out")
    assert (ended.code, ended.out) == (2, "")
    assert "kind 'damping' has nothing to export" in ended.err
    assert not (tmp_path / "out").exists()
