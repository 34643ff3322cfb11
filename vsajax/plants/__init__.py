"""Joints, their springs and bodies, and the integrator that moves them."""

from vsajax.plants.antagonistic import AntagonisticJoint, AntagonisticMotion
from vsajax.plants.bodies import CoulombFriction, Link, Motor
from vsajax.plants.joints import AbstractJoint, FlexibleJoint, Motion, SerialJoint, Torques
from vsajax.plants.presets import awas, menard_cubic, qbmove, vsa_exponential
from vsajax.plants.simulation import simulate
from vsajax.plants.splitting import substeps_for
from vsajax.plants.springs import (
    AbstractSpring,
    CubicSpring,
    ExponentialSpring,
    HyperbolicSpring,
    LeverSpring,
    LinearSpring,
    PolynomialSpring,
)

__all__ = [
    "AbstractJoint",
    "AbstractSpring",
    "AntagonisticJoint",
    "AntagonisticMotion",
    "CoulombFriction",
    "CubicSpring",
    "ExponentialSpring",
    "FlexibleJoint",
    "HyperbolicSpring",
    "LeverSpring",
    "LinearSpring",
    "Link",
    "Motion",
    "Motor",
    "PolynomialSpring",
    "SerialJoint",
    "Torques",
    "awas",
    "menard_cubic",
    "qbmove",
    "simulate",
    "substeps_for",
    "vsa_exponential",
]
