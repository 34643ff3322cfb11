"""The AwAS experiment of Flacco et al., IROS 2011, section VI-A, as `vsajax` objects."""

from __future__ import annotations

import math

import jax.numpy as jnp
import numpy as np

from vsajax import Recording
from vsajax.estimators import (
    AbstractTorqueSource,
    ModifiedKinematicKalman,
    RecursiveLeastSquares,
    ResidualTorque,
    SensorTorque,
    SeparableOddPolynomial,
    StiffnessEstimator,
)

PITCH = 0.0025 / (2.0 * math.pi)
SAMPLE_TIME = 1e-3


def quantise(position: np.ndarray, counts: int) -> np.ndarray:
    """Return an encoder's reading."""
    count = 2.0 * math.pi / counts
    return np.round(position / count) * count


def paper_recording(signals: dict[str, np.ndarray], source: str, samples: int | None = None) -> Recording:
    """Return what the estimator saw for "model" (the true torque), "sensor" or "residual"."""
    s = {name: jnp.asarray(value[:samples]) for name, value in signals.items()}
    positions = {
        "time": jnp.arange(len(s["q"])) * SAMPLE_TIME,
        "link_position": jnp.asarray(quantise(s["q"], 40000)),
        "motor_position": jnp.asarray(quantise(s["theta"], 40000)),
        "setpoint_position": jnp.asarray(quantise(s["theta_c"], 1024)),
    }
    match source:
        case "model":
            return Recording(**positions, elastic_torque=s["tau_e"])
        case "sensor":
            return Recording(**positions, elastic_torque=s["tau_e"] + s["noise_tau_e"])
        case _:
            return Recording(**positions, motor_torque=s["tau"] + s["noise_tau"])


def residual_torque(gain: object = 300.0) -> ResidualTorque:
    """Return the residual observer with the AwAS motor's parameters."""
    return ResidualTorque(gain, motor_inertia=2.3e-5, motor_damping=0.001, gear_ratio=50.0)


def paper_basis(deflection_terms: int = 6, setpoint_terms: int = 3) -> SeparableOddPolynomial:
    """Return the basis of the paper, set-point in millimetres."""
    return SeparableOddPolynomial(
        setpoint_origin=0.1,
        setpoint_scale=PITCH,
        setpoint_unit="mm",
        deflection_terms=deflection_terms,
        setpoint_terms=setpoint_terms,
    )


def paper_estimator(torque: AbstractTorqueSource | None = None, **changes: object) -> StiffnessEstimator:
    """Return the paper's estimator, κ = 1, with some parts changed."""
    parts = {
        "torque": SensorTorque() if torque is None else torque,
        "basis": paper_basis(),
        "fit": RecursiveLeastSquares(1.0),
        "velocity": ModifiedKinematicKalman(5e9),
        "matched": False,
    }
    return StiffnessEstimator(**(parts | changes))
