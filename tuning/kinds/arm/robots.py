"""From the table of an arm to kinematics that can be computed with."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tuning.kinds.arm.chain import Chain
from tuning.kinds.arm.kinematics import chain_of
from tuning.kinds.arm.tables import Arm
from vsajax.arms import SerialArm


def build_arm(table: Arm, place: str, folder: Path) -> tuple[SerialArm, np.ndarray]:
    """Return the arm and its joints' ranges [rad], `(joints, 2)`; as `chain_of`."""
    chain = chain_of(table, place, folder)
    return arm_of(chain), chain.ranges


def arm_of(chain: Chain) -> SerialArm:
    """Return the kinematics of a chain."""
    return SerialArm(chain.offsets, chain.rotations, chain.axes, chain.tool_offset, chain.tool_rotation)
