"""Serial arms: their kinematics and masses, which plants and controllers share."""

from vsajax.arms.bodies import ArmBodies
from vsajax.arms.kinematics import (
    Pose,
    SerialArm,
    rotation_about,
    scaled_rows,
    task_scale,
)

__all__ = [
    "ArmBodies",
    "Pose",
    "SerialArm",
    "rotation_about",
    "scaled_rows",
    "task_scale",
]
