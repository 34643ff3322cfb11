"""A log in closed form, of a motor of known inertia and damping on a spring, and the study that finds them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

INERTIA, DAMPING, GEAR, STIFFNESS = 3e-5, 4e-3, 40.0, 120.0
MOTOR_INERTIA, MOTOR_DAMPING = "estimator.torque.motor_inertia", "estimator.torque.motor_damping"
STUDY = """
schema_version = 1
kind = "sea"
[recording]
file = "{file}"
train_until = 3.0
[estimator]
deflection = "measured"
matched = true
[estimator.torque]
type = "residual"
observer_gain = 15.0
motor_inertia = 2e-5
motor_damping = 1e-4
gear_ratio = 40.0
[estimator.basis]
type = "odd"
deflection_scale = 0.05
deflection_offset = true
[estimator.fit]
prior_scale = 1e6
[tune]
starts = 2
screen = 8
[tune.parameters]
"estimator.torque.motor_damping" = {{ low = 1e-6, high = 1e-1 }}
"estimator.torque.motor_inertia" = {{ low = 1e-6, high = 1e-3 }}
"""


def write_log(path: Path) -> None:
    """Write what the motor and the spring show over 5 s."""
    time = 1e-3 * np.arange(5000)
    w, v = 2 * np.pi * 0.9, 2 * np.pi * 1.7
    motor = 0.4 * (1 - np.cos(w * time))
    speed, acceleration = 0.4 * w * np.sin(w * time), 0.4 * w**2 * np.cos(w * time)
    deflection = 0.03 * (np.cos(v * time) - 1) + 0.02 * (1 - np.cos(2.3 * v * time))
    torque = GEAR * (INERTIA * acceleration + DAMPING * speed) - STIFFNESS * deflection / GEAR
    columns = {"time": time, "motor_position": motor, "motor_torque": torque, "deflection": deflection}
    pq.write_table(pa.table(columns), path)


def write_study(folder: Path, more: str = "") -> Path:
    """Write the log and its study to a folder, and return the study's path."""
    write_log(folder / "log.parquet")
    path = folder / "study.toml"
    path.write_text(STUDY.format(file=folder / "log.parquet") + more)
    return path
