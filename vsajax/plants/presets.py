"""Joints whose parameters were published."""

from __future__ import annotations

import math

from vsajax.plants.antagonistic import AntagonisticJoint
from vsajax.plants.bodies import Link, Motor
from vsajax.plants.joints import SerialJoint
from vsajax.plants.springs import AbstractSpring, CubicSpring, ExponentialSpring, HyperbolicSpring, LeverSpring


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


def _menard(spring1: AbstractSpring, spring2: AbstractSpring) -> AntagonisticJoint:
    motor = Motor(inertia=1e-4, damping=1.27)
    return AntagonisticJoint(Link(inertia=0.0179, damping=0.0127), motor, motor, spring1, spring2)


def menard_cubic() -> AntagonisticJoint:
    """Return the simulated joint of Ménard, Grioli, Bicchi, section IV: fᵢ = 10 φᵢ³.

    Printed (29) has 10 (qᵢ − q_L)³, an unstable spring in (1)–(3); the inertias are in kg·m².
    """
    return _menard(CubicSpring(linear=0.0, cubic=10.0), CubicSpring(linear=0.0, cubic=10.0))


def vsa_exponential() -> AntagonisticJoint:
    """Return the same joint with progressive one-sided springs, f₁ = ½(e^(3φ₁) − 1), f₂ = −½(e^(−3φ₂) − 1)."""
    return _menard(
        ExponentialSpring(torque_scale=0.5, exponent=3.0, side=1.0),
        ExponentialSpring(torque_scale=0.5, exponent=3.0, side=-1.0),
    )


def qbmove() -> AntagonisticJoint:
    """Return a joint with the sinh springs of a qbmove-like module, fᵢ = k sinh(a φᵢ).

    The springs are those published for the qbmove maker pro (a₁ = 8.9995, a₂ = 8.9989 1/rad, k₁ = 0.0026 and
    k₂ = 0.0011 N·m); inertias and friction are plausible values for its geared motors and a light link.
    """
    motor = Motor(inertia=2e-4, damping=0.05)
    return AntagonisticJoint(
        Link(inertia=0.005, damping=0.01),
        motor,
        motor,
        HyperbolicSpring(torque_scale=0.0026, exponent=8.9995),
        HyperbolicSpring(torque_scale=0.0011, exponent=8.9989),
    )
