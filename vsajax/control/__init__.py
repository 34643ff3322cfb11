"""Controllers that damp a joint's oscillations; they know how a joint swings, never its model."""

from vsajax.control.base import AbstractController
from vsajax.control.observers import ObservedController, SwingObserver
from vsajax.control.position import BangBangPosition, PIDPosition
from vsajax.control.rules import (
    AbstractRule,
    Conic,
    DelayedRelease,
    FixedThresholds,
    RelativeThresholds,
    TimeLead,
)
from vsajax.control.stiffness import ConstantStiffness, Hold, SmoothStiffness, StiffnessSwitch

__all__ = [
    "AbstractController",
    "AbstractRule",
    "BangBangPosition",
    "Conic",
    "ConstantStiffness",
    "DelayedRelease",
    "FixedThresholds",
    "Hold",
    "ObservedController",
    "PIDPosition",
    "RelativeThresholds",
    "SmoothStiffness",
    "StiffnessSwitch",
    "SwingObserver",
    "TimeLead",
]
