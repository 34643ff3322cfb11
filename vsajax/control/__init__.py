"""Controllers of joints, and the design of what they and the joints' mechanisms are set to."""

from vsajax.control.active import fit_active, passive_scale
from vsajax.control.active_set import ActiveSet
from vsajax.control.base import AbstractController
from vsajax.control.box import AbstractBoxSolver, BoxLeastSquares, BoxSolution
from vsajax.control.designer import (
    Status,
    StiffnessDesign,
    StiffnessDesigner,
    StiffnessErrors,
    stiffness_errors,
)
from vsajax.control.enumeration import Enumeration
from vsajax.control.impedance import CartesianImpedance, design_damping, impedance_torque
from vsajax.control.interior_point import InteriorPoint
from vsajax.control.loaded import design_loaded, loaded_compliance
from vsajax.control.observers import ObservedController, SwingObserver
from vsajax.control.online import ArmCommand, ArmController, ArmReading
from vsajax.control.passive import (
    PassiveFit,
    StiffnessBounds,
    compliance_problem,
    fit_passive,
    hand_compliance,
)
from vsajax.control.pose import PoseSearch, improve_pose, reach
from vsajax.control.position import BangBangPosition, Combined, MotorPID, PIDPosition
from vsajax.control.rules import (
    AbstractRule,
    Conic,
    DelayedRelease,
    FixedThresholds,
    RelativeThresholds,
    TimeLead,
)
from vsajax.control.spectrum import eigen, inverse
from vsajax.control.stiffness import ConstantStiffness, Hold, SmoothStiffness, StiffnessSwitch

__all__ = [
    "AbstractBoxSolver",
    "AbstractController",
    "AbstractRule",
    "ActiveSet",
    "ArmCommand",
    "ArmController",
    "ArmReading",
    "BangBangPosition",
    "BoxLeastSquares",
    "BoxSolution",
    "CartesianImpedance",
    "Combined",
    "Conic",
    "ConstantStiffness",
    "DelayedRelease",
    "Enumeration",
    "FixedThresholds",
    "Hold",
    "InteriorPoint",
    "MotorPID",
    "ObservedController",
    "PIDPosition",
    "PassiveFit",
    "PoseSearch",
    "RelativeThresholds",
    "SmoothStiffness",
    "Status",
    "StiffnessBounds",
    "StiffnessDesign",
    "StiffnessDesigner",
    "StiffnessErrors",
    "StiffnessSwitch",
    "SwingObserver",
    "TimeLead",
    "compliance_problem",
    "design_damping",
    "design_loaded",
    "eigen",
    "fit_active",
    "fit_passive",
    "hand_compliance",
    "impedance_torque",
    "improve_pose",
    "inverse",
    "loaded_compliance",
    "passive_scale",
    "reach",
    "stiffness_errors",
]
