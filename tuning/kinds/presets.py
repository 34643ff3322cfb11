"""Joints and arms that lie in files of their own, checked as they would be in a study."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tuning.files.toml import validate
from tuning.kinds.arm.kinematics import chain_of
from tuning.kinds.arm.tables import Arm
from tuning.study.parts.joints import AntagonisticJoint, FlexibleJoint, SerialJoint


def parse_joint(tables: Mapping[str, Any], place: str) -> SerialJoint | FlexibleJoint | AntagonisticJoint:
    """Return the joint that tables describe; its motors tell which kind of joint it is.

    Raises:
        InputError: lists every mistake with its path.
    """
    if tables.keys() & {"motor1", "motor2", "spring1", "spring2"}:
        return validate(AntagonisticJoint, dict(tables), place)
    return validate(SerialJoint if "setpoint_motor" in tables else FlexibleJoint, dict(tables), place)


def parse_arm(tables: Mapping[str, Any], place: str) -> Arm:
    """Return the arm that tables describe; a URDF is read.

    Raises:
        InputError: lists every mistake with its path.
    """
    arm = validate(Arm, dict(tables), place)
    chain_of(arm, place, Path(place).parent)
    return arm
