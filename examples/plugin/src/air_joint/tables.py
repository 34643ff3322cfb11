"""The tables that a study may have, with the ranges of their numbers. Nothing here imports jax.

Every table has the fields of its class under the same names. The key `type` is not declared: it is the tag under
which the table is registered in pyproject.toml, or, where the package is not installed, `air_joint.tables:NAME`.
"""

from __future__ import annotations

from tuning.study.parts.base import AtLeastOne, NonNegative, Part, Positive, Scale
from tuning.study.parts.estimators import BasisTable, EstimatorTable, TorqueTable
from tuning.study.refs import Ref


class AirSpring(Part):
    """τ = rate · φ · √(1 + (φ/knee)²): a bellows that stiffens beyond its knee."""

    target = Ref("air_joint.modules:AirSpring")
    rate: Positive
    knee: Positive = 0.1


class RootBasis(BasisTable):
    """φ · (1 + (φ/knee)²)^(j/2) for j < terms: an air spring is the second of them."""

    target = Ref("air_joint.modules:RootBasis")
    deflection_scale: Scale = 1.0
    knee: Positive = 0.1
    terms: AtLeastOne = 2

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return self.terms


class StaticTorque(TorqueTable):
    """The elastic torque is what holds the motor, its acceleration neglected."""

    target = Ref("air_joint.modules:StaticTorque")
    gain: Positive
    motor_damping: NonNegative
    gear_ratio: Positive = 1.0

    @property
    def needs(self) -> frozenset[str]:
        """The signals that it reads."""
        return frozenset({"motor_position", "motor_torque"})


class SlopeEstimator(EstimatorTable):
    """The slope of the measured torque over the deflection of the last moments."""

    target = Ref("air_joint.modules:SlopeEstimator")
    memory: Positive
    least_range: NonNegative = 1e-3

    @property
    def needs(self) -> frozenset[str]:
        """The signals that must be measured."""
        return frozenset({"link_position", "motor_position", "elastic_torque"})
