"""Estimators and their parts."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from tuning.study.parts.base import AtLeastOne, Fraction, NonNegative, Part, Positive, Scale
from tuning.study.parts.springs import Spring
from tuning.study.refs import Ref
from tuning.study.slots import Slot


class TorqueTable(Part):
    """A source of the elastic torque."""

    @property
    def needs(self) -> frozenset[str]:
        """The signals that it reads itself; the built source says the same."""
        return frozenset()


class BasisTable(Part):
    """Functions of the deflection that the torque is a weighted sum of."""

    @property
    def size(self) -> int:
        """Number of coefficients; the built basis says the same."""
        raise NotImplementedError

    @property
    def uses_setpoint(self) -> bool:
        """Whether the setpoint must be measured; the built basis says the same."""
        return False


class EstimatorTable(Part):
    """An estimator of the stiffness."""

    @property
    def needs(self) -> frozenset[str]:
        """The signals that must be measured; the built estimator says the same."""
        raise NotImplementedError

    @property
    def size(self) -> int:
        """Number of coefficients of its largest fit: what its memory and time grow with."""
        return 1


class SensorTorque(TorqueTable):
    """The elastic torque is read from a joint torque sensor."""

    target = Ref("vsajax.estimators:SensorTorque")
    type: Literal["sensor"]

    @property
    def needs(self) -> frozenset[str]:
        """The signals that it reads itself."""
        return frozenset({"elastic_torque"})


class ModelTorque(TorqueTable):
    """The elastic torque is that of a nominal law."""

    target = Ref("vsajax.estimators:ModelTorque")
    type: Literal["model"]
    law: Spring


class ResidualTorque(TorqueTable):
    """The elastic torque is observed from the motor's momentum."""

    target = Ref("vsajax.estimators:ResidualTorque")
    type: Literal["residual"]
    observer_gain: Positive
    motor_inertia: Positive
    motor_damping: NonNegative
    gear_ratio: Annotated[float, Field(ge=1)] = 1.0
    friction_torque: NonNegative | None = None
    friction_velocity: Positive = 0.05

    @property
    def needs(self) -> frozenset[str]:
        """The signals that it reads itself."""
        return frozenset({"motor_position", "motor_torque"})


class FiniteDifference(Part):
    """Velocity by differencing."""

    target = Ref("vsajax.estimators:FiniteDifference")
    type: Literal["difference"]


class KinematicKalman(Part):
    """Kinematic Kalman filter with a constant reading variance."""

    target = Ref("vsajax.estimators:KinematicKalman")
    type: Literal["kalman"]
    acceleration_variance: Positive
    reading_variance: Positive
    start_position_variance: Positive = 10.0
    start_velocity_variance: Positive = 1.0


class ModifiedKinematicKalman(Part):
    """Kinematic Kalman filter whose reading variance falls with speed."""

    target = Ref("vsajax.estimators:ModifiedKinematicKalman")
    type: Literal["mkkf"]
    acceleration_variance: Positive
    slow_variance: Positive = 10.0
    fast_variance: Positive = 0.1
    sharpness: Positive = 6.0
    counts_per_revolution: Positive = 40000.0
    start_position_variance: Positive = 10.0
    start_velocity_variance: Positive = 1.0
    scaling: Literal["counts", "printed"] = "counts"


class SeparableOddPolynomial(BasisTable):
    """Powers of the setpoint times odd powers of the deflection."""

    target = Ref("vsajax.estimators:SeparableOddPolynomial")
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
    def uses_setpoint(self) -> bool:
        """Whether the setpoint must be measured."""
        return self.setpoint_terms > 1

    @property
    def _has_constant(self) -> bool:
        return self.torque_bias and not self.deflection_offset


class Polynomial(BasisTable):
    """1, x, …, x^order of the deflection."""

    target = Ref("vsajax.estimators:Polynomial")
    type: Literal["polynomial"]
    deflection_scale: Scale = 1.0
    order: AtLeastOne = 1

    @property
    def size(self) -> int:
        """Number of coefficients; the built basis says the same."""
        return self.order + 1


class Taylor(BasisTable):
    """φ^(j+1)/(j+1)! for j = 0 … order: a stiffness of that Taylor order."""

    target = Ref("vsajax.estimators:Taylor")
    type: Literal["taylor"]
    deflection_scale: Scale = 1.0
    order: Annotated[int, Field(ge=0, le=160)] = 2  # beyond, the factorials overflow

    @property
    def size(self) -> int:
        """Number of coefficients; the built basis says the same."""
        return self.order + 1


class Legendre(BasisTable):
    """Legendre polynomials on a range of deflection."""

    target = Ref("vsajax.estimators:Legendre")
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

    target = Ref("vsajax.estimators:UnitFactor")
    type: Literal["unit"] = "unit"


class EnhancedFactor(Part):
    """The printed stability factor (27), with c = constant and P(0) = prior_scale."""

    target = Ref("vsajax.estimators:EnhancedFactor")
    type: Literal["enhanced"]
    constant: Positive


class ConstantFactor(Part):
    """A constant stability factor."""

    target = Ref("vsajax.estimators:ConstantFactor")
    type: Literal["constant"]
    factor: Fraction


class ExponentialForgetting(Part):
    """Exponential forgetting."""

    target = Ref("vsajax.estimators:ExponentialForgetting")
    type: Literal["forgetting"]
    forgetting: Fraction


LAWS = Slot("laws", Part, UnitFactor, EnhancedFactor, ConstantFactor, ExponentialForgetting)


class RecursiveLeastSquares(Part):
    """The recursive fit."""

    target = Ref("vsajax.estimators:RecursiveLeastSquares")
    prior_scale: Positive
    law: Annotated[Part, LAWS] = UnitFactor()
    # Not in what is written and hashed while it does nothing: studies from before it keep their hashes.
    band: Positive = Field(default=1.0, exclude_if=lambda band: band == 1.0)


class ExcitationGate(Part):
    """When an answer is known."""

    target = Ref("vsajax.estimators:ExcitationGate")
    min_deflection_range: NonNegative = 0.0
    max_relative_std: Positive = 0.1


TORQUES = Slot("torques", TorqueTable, SensorTorque, ModelTorque, ResidualTorque)
VELOCITIES = Slot("velocities", Part, FiniteDifference, KinematicKalman, ModifiedKinematicKalman)
BASES = Slot("bases", BasisTable, SeparableOddPolynomial, Polynomial, Taylor, Legendre)
Torque = Annotated[TorqueTable, TORQUES]
VelocityFilter = Annotated[Part, VELOCITIES]
Basis = Annotated[BasisTable, BASES]


class StiffnessEstimator(EstimatorTable):
    """Torque, velocity filter, basis and recursive fit."""

    target = Ref("vsajax.estimators:StiffnessEstimator")
    type: Literal["two_stage"] = "two_stage"
    torque: Torque
    basis: Basis
    fit: RecursiveLeastSquares
    velocity: VelocityFilter = FiniteDifference(type="difference")
    gate: ExcitationGate = ExcitationGate()
    deflection: Literal["filtered", "raw", "measured"] = "filtered"
    matched: bool = True

    @property
    def needs(self) -> frozenset[str]:
        """The signals that must be measured; the built estimator says the same."""
        positions = {"deflection"} if self.deflection == "measured" else {"link_position", "motor_position"}
        return self.torque.needs | positions | _setpoint_of(self.basis)

    @property
    def size(self) -> int:
        """Number of coefficients of its fit."""
        return self.basis.size


class AlgebraicObserver(EstimatorTable):
    """The motor equation over a moving window, and a recursive fit."""

    target = Ref("vsajax.estimators:AlgebraicObserver")
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
        return frozenset({"link_position", "motor_position", "motor_torque"}) | _setpoint_of(self.basis)

    @property
    def size(self) -> int:
        """Number of coefficients of its fit."""
        return self.basis.size


def _setpoint_of(basis: BasisTable) -> frozenset[str]:
    return frozenset({"setpoint_position"} if basis.uses_setpoint else ())


SIDES = Slot("estimators", EstimatorTable, StiffnessEstimator, AlgebraicObserver, otherwise="two_stage")
"""Estimators of one transmission."""
Side = Annotated[EstimatorTable, SIDES]


class AntagonisticPair(EstimatorTable):
    """One estimator a side of an antagonistic joint; `other` where the second differs from the first."""

    target = Ref("vsajax.estimators:AntagonisticPair")
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

    @property
    def size(self) -> int:
        """Number of coefficients of the larger fit."""
        return max(side.size for side in (self.side, self.other) if side is not None)


ESTIMATORS = SIDES.of(StiffnessEstimator, AlgebraicObserver, AntagonisticPair)
Estimator = Annotated[EstimatorTable, ESTIMATORS]
