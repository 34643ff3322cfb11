"""Small studies: the shipped ones, shortened and with few coefficients, so that they compile in seconds."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax

from tuning.files.seal import SEALED, seal_tables
from tuning.files.shipped import CONFIGS
from tuning.problem.scenarios import Scenario, Stream, draw_scenarios
from tuning.study.base import Study, hash_resolved
from tuning.study.loading import load_study

EXAMPLES = sorted(path for path in (CONFIGS / "studies").glob("*.toml") if path.stem != "arm")
TUNED = sorted((CONFIGS / "tuned").glob("*.toml"))
SERIAL, SEA, ANTAGONISTIC = (CONFIGS / "studies" / f"{kind}.toml" for kind in ("serial", "sea", "antagonistic"))
RESIDUAL_PAIR = CONFIGS / "tuned" / "antagonistic_residual.toml"

GAIN, PRIOR = "estimator.torque.observer_gain", "estimator.fit.prior_scale"
NOISE = "sensing.elastic_torque.noise_std"
FORGETTING = "estimator.fit.law.forgetting"
WINDOW = "estimator.side.window"

# At 0.1 Hz the AwAS hardly moves in a fraction of a second: drive it faster.
SMALL = (
    "clock.duration=0.2",
    "integration_tolerance=1e-6",
    "excitation.motor.frequency=2.0",
    "excitation.setpoint_motor.frequency=1.0",
    "estimator.basis.deflection_terms=1",
    "estimator.basis.setpoint_terms=2",
    "scenarios={train=3, held_out=5}",
    "sweep={}",
    "tune={}",
)

TINY = (
    "estimator.torque={type='sensor'}",
    "estimator.velocity={type='difference'}",
    "estimator.basis={type='odd'}",
)

RESIDUAL = "estimator.torque={type='residual', observer_gain=100.0, motor_inertia=1e-4, motor_damping=0.01}"


def small_serial(*settings: str) -> Study:
    """Return the AwAS study over 0.2 s with two coefficients, no grid and nothing to tune."""
    return load_study(SERIAL, [*SMALL, *settings])


def tiny_serial(*settings: str) -> Study:
    """Return the same with one coefficient fitted to a torque sensor: nothing compiles faster."""
    return small_serial(*TINY, *settings)


def tiny_tuning(*settings: str) -> Study:
    """Return the same with two of its numbers to tune, starting with too long a memory."""
    prior = f"'{PRIOR}' = {{ low = 1e-3, high = 10.0, points = 3 }}"
    bounds = f"{prior}, '{FORGETTING}' = {{ low = 0.5, high = 0.999 }}"
    return tiny_serial(
        "estimator.fit={ prior_scale = 1.0, law = { type = 'forgetting', forgetting = 0.95 } }",
        f"tune={{ starts = 2, screen = 4, max_steps = 20, parameters = {{ {bounds} }} }}",
        *settings,
    )


def small_antagonistic(*settings: str) -> Study:
    """Return the antagonistic study over 1.5 s with a window of 0.3 s, no grid and nothing to tune."""
    short = ("clock.duration=1.5", "scorer.warm_up=0.6", f"{WINDOW}=0.3", "scenarios={train=4, held_out=6}")
    return load_study(ANTAGONISTIC, [*short, "sweep={}", "tune.parameters={}", *settings])


def scenarios_of(study: Study, stream: Stream, count: int) -> list[Scenario]:
    """Return the first scenarios of a stream, one by one."""
    drawn = draw_scenarios(study, stream, count)
    return [jax.tree.map(lambda x, i=i: x[i], drawn) for i in range(count)]


def edit_manifest(folder: Path, edit: Callable[[dict[str, Any]], Any]) -> None:
    """Change a manifest in place as if the run had been begun so: its hash and its seal fit."""
    path = folder / "manifest.json"
    manifest = json.loads(path.read_text())
    manifest.pop(SEALED)
    edit(manifest)
    manifest["study_hash"] = hash_resolved(manifest["study"])
    path.write_text(json.dumps(seal_tables(manifest)))
