"""Joints and their bodies."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field

from tuning.files.toml import validate
from tuning.study.parts.base import NonNegative, Part, Positive
from tuning.study.parts.springs import Spring
from tuning.study.refs import Ref
from tuning.study.slots import Slot


class CoulombFriction(Part):
    """Dry friction, smoothed over a small velocity."""

    target = Ref("vsajax.plants:CoulombFriction")
    torque: NonNegative
    velocity_scale: Positive = 0.05


class Link(Part):
    """The driven link."""

    target = Ref("vsajax.plants:Link")
    inertia: Positive
    damping: NonNegative
    gravity: float | None = None
    friction: CoulombFriction | None = None


class Motor(Part):
    """A geared motor."""

    target = Ref("vsajax.plants:Motor")
    inertia: Positive
    damping: NonNegative
    gear_ratio: Annotated[float, Field(ge=1)] = 1.0
    friction: CoulombFriction | None = None


class SerialJoint(Part):
    """A principal motor moves the link, a secondary motor sets its stiffness."""

    target = Ref("vsajax.plants:SerialJoint")
    link: Link
    motor: Motor
    setpoint_motor: Motor
    spring: Spring
    setpoint_start: float = 0.0
    start: float = 0.0


class FlexibleJoint(Part):
    """A motor drives a link through one spring."""

    target = Ref("vsajax.plants:FlexibleJoint")
    link: Link
    motor: Motor
    spring: Spring
    start: float = 0.0


class AntagonisticJoint(Part):
    """Two motors pull one link through a spring each."""

    target = Ref("vsajax.plants:AntagonisticJoint")
    link: Link
    motor1: Motor
    motor2: Motor
    spring1: Spring
    spring2: Spring


JOINTS = Slot(
    "joints",
    Part,
    untagged={"serial": SerialJoint, "sea": FlexibleJoint, "antagonistic": AntagonisticJoint},
)
"""A study's kind tells which of vsajax' own its joint is."""


def parse_joint(tables: Mapping[str, Any], place: str) -> SerialJoint | FlexibleJoint | AntagonisticJoint:
    """Return the joint that tables describe; its motors tell which kind of joint it is.

    Raises:
        InputError: lists every mistake with its path.
    """
    if tables.keys() & {"motor1", "motor2", "spring1", "spring2"}:
        return validate(AntagonisticJoint, dict(tables), place)
    return validate(SerialJoint if "setpoint_motor" in tables else FlexibleJoint, dict(tables), place)
