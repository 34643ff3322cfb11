"""The slots by name: every place in a study where somebody else's part may stand."""

from __future__ import annotations

from tuning.study.parts.estimators import BASES, ESTIMATORS, LAWS, TORQUES, VELOCITIES
from tuning.study.parts.joints import JOINTS
from tuning.study.parts.rig import EXCITATIONS, SENSORS
from tuning.study.parts.springs import SPRINGS
from tuning.study.parts.swings import CONTROLLERS, PLANTS, RULES

SLOTS = {
    slot.name: slot
    for slot in (
        *(SPRINGS, JOINTS, EXCITATIONS, SENSORS),
        *(TORQUES, VELOCITIES, BASES, LAWS, ESTIMATORS),
        *(PLANTS, CONTROLLERS, RULES),
    )
}
