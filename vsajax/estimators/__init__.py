"""Online estimators of joint stiffness; they know recordings, never plants."""

from vsajax.estimators.algebraic import AlgebraicObserver
from vsajax.estimators.base import AbstractEstimator, Prepared
from vsajax.estimators.bases import (
    AbstractBasis,
    Legendre,
    Polynomial,
    SeparableOddPolynomial,
    Taylor,
)
from vsajax.estimators.gate import ExcitationGate
from vsajax.estimators.pair import AntagonisticPair
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
    "AlgebraicObserver",
    "AntagonisticPair",
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
    "Prepared",
    "RecursiveLeastSquares",
    "ResidualTorque",
    "SensorTorque",
    "SeparableOddPolynomial",
    "StiffnessEstimator",
    "Taylor",
    "UnitFactor",
]
