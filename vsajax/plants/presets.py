"""Joints whose parameters were published."""

from __future__ import annotations

import math

from vsajax.plants.bodies import Link, Motor
from vsajax.plants.joints import SerialJoint
from vsajax.plants.springs import LeverSpring


def awas() -> SerialJoint:
    """Return the AwAS of Flacco et al., IROS 2011, section VI-A, started at a lever arm of 70 mm.

    Printed is θ_c(0) = −30/b, which is in millimetres; −0.03/b is what explains Table I.
    """
    pitch = 0.0025 / (2.0 * math.pi)
    return SerialJoint(
        link=Link(inertia=0.1, damping=0.15),
        motor=Motor(inertia=2.3e-5, damping=0.001, gear_ratio=50.0),
        setpoint_motor=Motor(inertia=1.29e-7, damping=0.0141, gear_ratio=23.0),
        spring=LeverSpring(spring_rate=14220.0, arm=0.1, pitch=pitch),
        setpoint_start=-0.03 / pitch,
    )
