"""Joints, their springs and bodies, and the integrator that moves them."""

from vsajax.plants.antagonistic import AntagonisticJoint, AntagonisticMotion
from vsajax.plants.bodies import CoulombFriction, Link, Motor
from vsajax.plants.compliant_arm import ArmMotion, CompliantArm
from vsajax.plants.joints import AbstractJoint, FlexibleJoint, Motion, SerialJoint, Torques
from vsajax.plants.preset_spring import PresetSpring
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
    "ArmMotion",
    "CompliantArm",
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
    "PresetSpring",
    "SerialJoint",
    "Torques",
    "awas",
    "menard_cubic",
    "qbmove",
    "simulate",
    "substeps_for",
    "vsa_exponential",
]
