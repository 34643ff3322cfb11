"""One of every estimator, and a recording that has every signal."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from tests.vsajax.builders import SAMPLE_TIME, paper_basis, paper_estimator, residual_torque
from vsajax import Recording
from vsajax.estimators import (
    AlgebraicObserver,
    AntagonisticPair,
    ExcitationGate,
    ExponentialForgetting,
    FiniteDifference,
    KinematicKalman,
    ModelTorque,
    RecursiveLeastSquares,
    SensorTorque,
    StiffnessEstimator,
    Taylor,
)
from vsajax.plants import CubicSpring

FIT = RecursiveLeastSquares(1e3)
GATE = ExcitationGate(1e-3, 0.2)


def algebraic(**options) -> AlgebraicObserver:
    return AlgebraicObserver(
        1e-4, 1.27, 0.02, Taylor(0.1, order=1), FIT, longest_window=0.02, gate=GATE, **options
    )


ESTIMATORS = {
    "sensor": paper_estimator(SensorTorque(), basis=paper_basis(2, 2), gate=GATE),
    "residual": paper_estimator(residual_torque(), basis=paper_basis(2, 1), gate=GATE),
    "matched": paper_estimator(residual_torque(20.0), basis=paper_basis(2, 2), gate=GATE, matched=True),
    "model": StiffnessEstimator(
        ModelTorque(CubicSpring(100.0, 1e3)),
        Taylor(0.1, order=1),
        RecursiveLeastSquares(1e3, ExponentialForgetting(0.99)),
        deflection="raw",
    ),
    "kalman": paper_estimator(residual_torque(), basis=paper_basis(1, 1), velocity=KinematicKalman(5e9, 10.0)),
    "algebraic": algebraic(velocity=FiniteDifference()),
    "algebraic from rest": algebraic(start="rest", scaling="scale_free"),
    "pair": AntagonisticPair(algebraic()),
    "unequal pair": AntagonisticPair(
        paper_estimator(residual_torque(), basis=Taylor(0.1, order=1)),
        paper_estimator(residual_torque(100.0), basis=Taylor(0.1, order=1)),
    ),
}


def full_recording(samples: int = 60) -> Recording:
    """Return every signal as another smooth wave, deflections of a few hundredths of a radian."""
    time = np.arange(samples) * SAMPLE_TIME
    waves = {
        name: jnp.asarray(0.05 * np.sin((30.0 + 7.0 * i) * time + 0.3 * i))
        for i, name in enumerate(Recording._fields[1:])
    }
    return Recording(jnp.asarray(time), **waves)
