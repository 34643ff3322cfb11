"""Estimators and their parts."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from tuning.study.parts.base import AtLeastOne, Fraction, NonNegative, Part, Positive, Scale
from tuning.study.parts.springs import Spring


class SensorTorque(Part):
    """The elastic torque is read from a joint torque sensor."""

    target = "estimators.SensorTorque"
    type: Literal["sensor"]


class ModelTorque(Part):
    """The elastic torque is that of a nominal law."""

    target = "estimators.ModelTorque"
    type: Literal["model"]
    law: Spring


class ResidualTorque(Part):
    """The elastic torque is observed from the motor's momentum."""

    target = "estimators.ResidualTorque"
    type: Literal["residual"]
    observer_gain: Positive
    motor_inertia: Positive
    motor_damping: NonNegative
    gear_ratio: Annotated[float, Field(ge=1)] = 1.0
    friction_torque: NonNegative | None = None
    friction_velocity: Positive = 0.05


class FiniteDifference(Part):
    """Velocity by differencing."""

    target = "estimators.FiniteDifference"
    type: Literal["difference"]


class KinematicKalman(Part):
    """Kinematic Kalman filter with a constant reading variance."""

    target = "estimators.KinematicKalman"
    type: Literal["kalman"]
    acceleration_variance: Positive
    reading_variance: Positive
    start_position_variance: Positive = 10.0
    start_velocity_variance: Positive = 1.0


class ModifiedKinematicKalman(Part):
    """Kinematic Kalman filter whose reading variance falls with speed."""

    target = "estimators.ModifiedKinematicKalman"
    type: Literal["mkkf"]
    acceleration_variance: Positive
    slow_variance: Positive = 10.0
    fast_variance: Positive = 0.1
    sharpness: Positive = 6.0
    counts_per_revolution: Positive = 40000.0
    start_position_variance: Positive = 10.0
    start_velocity_variance: Positive = 1.0
    scaling: Literal["counts", "printed"] = "counts"


class SeparableOddPolynomial(Part):
    """Powers of the setpoint times odd powers of the deflection."""

    target = "estimators.SeparableOddPolynomial"
    type: Literal["odd"]
    deflection_scale: Scale = 1.0
    setpoint_origin: float = 0.0
    setpoint_scale: float = 1.0
    deflection_terms: AtLeastOne = 1
    setpoint_terms: AtLeastOne = 1
    setpoint_unit: Literal["rad", "m", "mm"] = "rad"
    deflection_offset: bool = False
    torque_bias: bool = False

    @property
    def size(self) -> int:
        """Number of coefficients; the built basis says the same."""
        return (
            self.deflection_terms * self.setpoint_terms * (2 if self.deflection_offset else 1) + self._has_constant
        )

    @property
    def _has_constant(self) -> bool:
        return self.torque_bias and not self.deflection_offset


class Polynomial(Part):
    """1, x, …, x^order of the deflection."""

    target = "estimators.Polynomial"
    type: Literal["polynomial"]
    deflection_scale: Scale = 1.0
    order: AtLeastOne = 1

    @property
    def size(self) -> int:
        """Number of coefficients; the built basis says the same."""
        return self.order + 1


class Taylor(Part):
    """φ^(j+1)/(j+1)! for j = 0 … order: a stiffness of that Taylor order."""

    target = "estimators.Taylor"
    type: Literal["taylor"]
    deflection_scale: Scale = 1.0
    order: Annotated[int, Field(ge=0, le=160)] = 2  # beyond, the factorials overflow

    @property
    def size(self) -> int:
        """Number of coefficients; the built basis says the same."""
        return self.order + 1


class Legendre(Part):
    """Legendre polynomials on a range of deflection."""

    target = "estimators.Legendre"
    ordered = ("lower", "upper", "rad")
    type: Literal["legendre"]
    lower: float
    upper: float
    order: AtLeastOne = 3

    @property
    def size(self) -> int:
        """Number of coefficients; the built basis says the same."""
        return self.order + 1


class UnitFactor(Part):
    """Ordinary recursive least squares."""

    target = "estimators.UnitFactor"
    type: Literal["unit"] = "unit"


class EnhancedFactor(Part):
    """The printed stability factor (27), with c = constant and P(0) = prior_scale."""

    target = "estimators.EnhancedFactor"
    type: Literal["enhanced"]
    constant: Positive


class ConstantFactor(Part):
    """A constant stability factor."""

    target = "estimators.ConstantFactor"
    type: Literal["constant"]
    factor: Fraction


class ExponentialForgetting(Part):
    """Exponential forgetting."""

    target = "estimators.ExponentialForgetting"
    type: Literal["forgetting"]
    forgetting: Fraction


class RecursiveLeastSquares(Part):
    """The recursive fit."""

    target = "estimators.RecursiveLeastSquares"
    prior_scale: Positive
    law: Annotated[
        UnitFactor | EnhancedFactor | ConstantFactor | ExponentialForgetting, Field(discriminator="type")
    ] = UnitFactor()


class ExcitationGate(Part):
    """When an answer is known."""

    target = "estimators.ExcitationGate"
    min_deflection_range: NonNegative = 0.0
    max_relative_std: Positive = 0.1


Basis = Annotated[SeparableOddPolynomial | Polynomial | Taylor | Legendre, Field(discriminator="type")]
VelocityFilter = Annotated[
    FiniteDifference | KinematicKalman | ModifiedKinematicKalman, Field(discriminator="type")
]


class StiffnessEstimator(Part):
    """Torque, velocity filter, basis and recursive fit."""

    target = "estimators.StiffnessEstimator"
    type: Literal["two_stage"] = "two_stage"
    torque: Annotated[SensorTorque | ModelTorque | ResidualTorque, Field(discriminator="type")]
    basis: Basis
    fit: RecursiveLeastSquares
    velocity: VelocityFilter = FiniteDifference(type="difference")
    gate: ExcitationGate = ExcitationGate()
    deflection: Literal["filtered", "raw", "measured"] = "filtered"
    matched: bool = False

    @property
    def needs(self) -> frozenset[str]:
        """The signals that must be measured; the built estimator says the same."""
        torque = {"sensor": {"elastic_torque"}, "residual": {"motor_position", "motor_torque"}, "model": set()}
        positions = {"deflection"} if self.deflection == "measured" else {"link_position", "motor_position"}
        return frozenset(torque[self.torque.type] | positions | _setpoint_of(self.basis))


class AlgebraicObserver(Part):
    """The motor equation over a moving window, and a recursive fit."""

    target = "estimators.AlgebraicObserver"
    static = frozenset({"longest_window", "sample_time"})
    type: Literal["algebraic"]
    motor_inertia: Positive
    motor_damping: NonNegative
    gear_ratio: Annotated[float, Field(ge=1)] = 1.0
    window: Positive
    longest_window: Positive | None = None
    sample_time: Positive
    basis: Basis
    fit: RecursiveLeastSquares
    gate: ExcitationGate = ExcitationGate()
    velocity: VelocityFilter | None = None
    quadrature: Literal["product", "trapezoid", "simpson"] = "product"
    weighting: Literal["sample", "continuous"] = "sample"
    scaling: Literal["printed", "scale_free"] = "printed"
    start: Literal["window", "zeros", "rest"] = "window"

    @model_validator(mode="after")
    def _window_fits(self) -> AlgebraicObserver:
        if self.longest_window is not None and self.window > self.longest_window:
            raise ValueError(
                f"window must not exceed longest_window; got {self.window} and {self.longest_window} s"
            )
        if self.window < 4 * self.sample_time:
            raise ValueError(f"window must hold at least four sample times; got {self.window} s")
        return self

    def arguments(self) -> dict[str, Any]:
        """Return the constructor's arguments; the longest window is by default the window."""
        return super().arguments() | {"longest_window": self.longest_window or self.window}

    @property
    def needs(self) -> frozenset[str]:
        """The signals that must be measured; the built estimator says the same."""
        return frozenset({"link_position", "motor_position", "motor_torque"} | _setpoint_of(self.basis))


def _setpoint_of(basis: Basis) -> set[str]:
    has_setpoint = isinstance(basis, SeparableOddPolynomial) and basis.setpoint_terms > 1
    return {"setpoint_position"} if has_setpoint else set()


def _type_of(table: Any) -> str:
    """Return the tag of an estimator's table; it is "two_stage" where none is given."""
    return table.get("type", "two_stage") if isinstance(table, dict) else getattr(table, "type", "two_stage")


Side = Annotated[
    Annotated[StiffnessEstimator, Tag("two_stage")] | Annotated[AlgebraicObserver, Tag("algebraic")],
    Discriminator(_type_of),
]


class AntagonisticPair(Part):
    """One estimator a side of an antagonistic joint; `other` where the second differs from the first."""

    target = "estimators.AntagonisticPair"
    type: Literal["pair"]
    side: Side
    other: Side | None = None

    @property
    def needs(self) -> frozenset[str]:
        """The signals that must be measured; the built estimator says the same."""
        sides = {1: self.side, 2: self.other or self.side}
        return frozenset(
            name.replace("motor_", f"motor{number}_") if name in ("motor_position", "motor_torque") else name
            for number, side in sides.items()
            for name in side.needs
        )


Estimator = Annotated[
    Annotated[StiffnessEstimator, Tag("two_stage")]
    | Annotated[AlgebraicObserver, Tag("algebraic")]
    | Annotated[AntagonisticPair, Tag("pair")],
    Discriminator(_type_of),
]
