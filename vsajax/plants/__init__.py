"""Joints, their springs and bodies, and the integrator that moves them."""

from vsajax.plants.antagonistic import AntagonisticJoint, AntagonisticMotion
from vsajax.plants.bodies import CoulombFriction, Link, Motor
from vsajax.plants.compliant_arm import ArmMotion, CompliantArm
from vsajax.plants.joints import AbstractJoint, FlexibleJoint, Motion, SerialJoint, Torques
from vsajax.plants.mechanisms import AbstractMechanism, ArmLink, PlanarArm, SingleLink
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
from vsajax.plants.switched import PositionMotor, StiffnessActuator, SwitchedPlant, SwitchedState

__all__ = [
    "AbstractJoint",
    "AbstractMechanism",
    "AbstractSpring",
    "AntagonisticJoint",
    "AntagonisticMotion",
    "ArmLink",
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
    "PlanarArm",
    "PolynomialSpring",
    "PositionMotor",
    "PresetSpring",
    "SerialJoint",
    "SingleLink",
    "StiffnessActuator",
    "SwitchedPlant",
    "SwitchedState",
    "Torques",
    "awas",
    "menard_cubic",
    "qbmove",
    "simulate",
    "substeps_for",
    "vsa_exponential",
]
