"""Elastic characteristics."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from tuning.files.toml import NO_SWITCH
from tuning.study.parts.base import NonNegative, Part, Positive
from tuning.study.refs import Ref
from tuning.study.slots import Slot


class LinearSpring(Part):
    """τ = rate · φ."""

    target = Ref("vsajax.plants:LinearSpring")
    type: Literal["linear"]
    rate: Positive


class CubicSpring(Part):
    """τ = linear · φ + cubic · φ³."""

    target = Ref("vsajax.plants:CubicSpring")
    type: Literal["cubic"]
    linear: NonNegative
    cubic: float


class PolynomialSpring(Part):
    """τ = Σ coefficients[i] · φ^(2i+1)."""

    target = Ref("vsajax.plants:PolynomialSpring")
    type: Literal["polynomial"]
    coefficients: Annotated[list[float], Field(min_length=1)]


class ExponentialSpring(Part):
    """τ = side · torque_scale · (e^(side · exponent · φ) − 1)."""

    target = Ref("vsajax.plants:ExponentialSpring")
    type: Literal["exponential"]
    torque_scale: Positive
    exponent: Positive
    side: Annotated[Literal[1, -1], NO_SWITCH] = 1


class HyperbolicSpring(Part):
    """τ = torque_scale · sinh(exponent · φ)."""

    target = Ref("vsajax.plants:HyperbolicSpring")
    type: Literal["hyperbolic"]
    torque_scale: Positive
    exponent: Positive


class LeverSpring(Part):
    """τ = spring_rate · r² · sin 2φ with r = arm + pitch · θ_c."""

    target = Ref("vsajax.plants:LeverSpring")
    type: Literal["lever"]
    spring_rate: Positive
    arm: Positive
    pitch: float


SPRINGS = Slot(
    "springs",
    Part,
    LinearSpring,
    CubicSpring,
    PolynomialSpring,
    ExponentialSpring,
    HyperbolicSpring,
    LeverSpring,
)
Spring = Annotated[Part, SPRINGS]
