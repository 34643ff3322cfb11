"""Joints, their springs and bodies, and the integrator that moves them."""

from vsajax.plants.bodies import CoulombFriction, Link, Motor
from vsajax.plants.joints import AbstractJoint, FlexibleJoint, Motion, SerialJoint, Torques
from vsajax.plants.presets import awas
from vsajax.plants.simulation import simulate
from vsajax.plants.splitting import substeps_for
from vsajax.plants.springs import (
    AbstractSpring,
    CubicSpring,
    ExponentialSpring,
    LeverSpring,
    LinearSpring,
    PolynomialSpring,
)

__all__ = [
    "AbstractJoint",
    "AbstractSpring",
    "CoulombFriction",
    "CubicSpring",
    "ExponentialSpring",
    "FlexibleJoint",
    "LeverSpring",
    "LinearSpring",
    "Link",
    "Motion",
    "Motor",
    "PolynomialSpring",
    "SerialJoint",
    "Torques",
    "awas",
    "simulate",
    "substeps_for",
]
