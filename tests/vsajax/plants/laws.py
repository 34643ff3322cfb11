"""One of every spring, for contract tests."""

from __future__ import annotations

import jax.numpy as jnp

from tests.vsajax.builders import PITCH
from vsajax.plants import (
    CubicSpring,
    ExponentialSpring,
    HyperbolicSpring,
    LeverSpring,
    LinearSpring,
    PolynomialSpring,
    PresetSpring,
)

SPRINGS = {
    "linear": LinearSpring(30.0),
    "cubic": CubicSpring(20.0, 400.0),
    "polynomial": PolynomialSpring([15.0, -40.0, 900.0, 50.0]),
    "progressive": ExponentialSpring(0.4, 9.0),
    "regressive": ExponentialSpring(0.4, 9.0, side=-1.0),
    "hyperbolic": HyperbolicSpring(0.0026, 8.9995),
    "lever": LeverSpring(spring_rate=14220.0, arm=0.1, pitch=PITCH),
    "preset": PresetSpring(0.2),
}
SETPOINTS = {name: jnp.asarray([-0.03 / PITCH, -0.01 / PITCH, 0.0]) for name in SPRINGS}
# The set-point of a preset spring is its stiffness without load.
SETPOINTS["preset"] = jnp.asarray([300.0, 50.0, 5.0])
