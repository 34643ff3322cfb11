"""The stiffness of an arm's hand: what joints give passively, what a controller adds, and the design of both."""

from vsajax.compliance.active import fit_active, passive_scale
from vsajax.compliance.designer import (
    Status,
    StiffnessDesign,
    StiffnessDesigner,
    StiffnessErrors,
    stiffness_errors,
)
from vsajax.compliance.impedance import CartesianImpedance, design_damping, impedance_torque
from vsajax.compliance.loaded import design_loaded, loaded_compliance
from vsajax.compliance.online import ArmCommand, ArmController, ArmReading
from vsajax.compliance.passive import PassiveFit, StiffnessBounds, compliance_problem, fit_passive, hand_compliance
from vsajax.compliance.pose import PoseSearch, improve_pose, reach

__all__ = [
    "ArmCommand",
    "ArmController",
    "ArmReading",
    "CartesianImpedance",
    "PassiveFit",
    "PoseSearch",
    "Status",
    "StiffnessBounds",
    "StiffnessDesign",
    "StiffnessDesigner",
    "StiffnessErrors",
    "compliance_problem",
    "design_damping",
    "design_loaded",
    "fit_active",
    "fit_passive",
    "hand_compliance",
    "impedance_torque",
    "improve_pose",
    "loaded_compliance",
    "passive_scale",
    "reach",
    "stiffness_errors",
]
