"""Online estimators of joint stiffness; they know recordings, never plants."""

from vsajax.estimators.base import AbstractEstimator
from vsajax.estimators.bases import (
    AbstractBasis,
    Legendre,
    Polynomial,
    SeparableOddPolynomial,
)
from vsajax.estimators.gate import ExcitationGate
from vsajax.estimators.rls import (
    AbstractGainLaw,
    ConstantFactor,
    EnhancedFactor,
    ExponentialForgetting,
    RecursiveLeastSquares,
    UnitFactor,
)
from vsajax.estimators.stiffness import StiffnessEstimator
from vsajax.estimators.torque import (
    AbstractTorqueSource,
    Kinematics,
    ModelTorque,
    ResidualTorque,
    SensorTorque,
)
from vsajax.estimators.velocity import (
    AbstractVelocityFilter,
    FiniteDifference,
    KinematicKalman,
    ModifiedKinematicKalman,
)

__all__ = [
    "AbstractBasis",
    "AbstractEstimator",
    "AbstractGainLaw",
    "AbstractTorqueSource",
    "AbstractVelocityFilter",
    "ConstantFactor",
    "EnhancedFactor",
    "ExcitationGate",
    "ExponentialForgetting",
    "FiniteDifference",
    "KinematicKalman",
    "Kinematics",
    "Legendre",
    "ModelTorque",
    "ModifiedKinematicKalman",
    "Polynomial",
    "RecursiveLeastSquares",
    "ResidualTorque",
    "SensorTorque",
    "SeparableOddPolynomial",
    "StiffnessEstimator",
    "UnitFactor",
]
