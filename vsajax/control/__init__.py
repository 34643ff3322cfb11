"""Controllers of joints: what switches their stiffness and drives their motors."""

from vsajax import moved
from vsajax.control.base import AbstractController
from vsajax.control.observers import ObservedController, SwingObserver
from vsajax.control.position import BangBangPosition, Combined, MotorPID, PIDPosition
from vsajax.control.rules import AbstractRule, Conic, DelayedRelease, FixedThresholds, RelativeThresholds, TimeLead
from vsajax.control.stiffness import ConstantStiffness, Hold, SmoothStiffness, StiffnessSwitch

_MOVED = {
    "vsajax.compliance": (
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
    ),
    "vsajax.solvers": (
        "AbstractBoxSolver",
        "ActiveSet",
        "BoxLeastSquares",
        "BoxSolution",
        "Enumeration",
        "InteriorPoint",
        "eigen",
        "inverse",
    ),
}
__getattr__ = moved.old_names("vsajax.control", {name: new for new, names in _MOVED.items() for name in names})

__all__ = [
    "AbstractController",
    "AbstractRule",
    "BangBangPosition",
    "Combined",
    "Conic",
    "ConstantStiffness",
    "DelayedRelease",
    "FixedThresholds",
    "Hold",
    "MotorPID",
    "ObservedController",
    "PIDPosition",
    "RelativeThresholds",
    "SmoothStiffness",
    "StiffnessSwitch",
    "SwingObserver",
    "TimeLead",
]
