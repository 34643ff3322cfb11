"""Which of its parts a configuration is exported for."""

from __future__ import annotations

from tuning.exports.configs import Exportable
from tuning.exports.deployable import Deployable
from tuning.files.errors import input_error
from tuning.kinds.arm.deployable import DeployableDesigner
from tuning.kinds.arm.study import ArmStudy
from tuning.kinds.damping.deployable import DeployableController
from tuning.kinds.estimation.deployable import DeployableEstimator
from tuning.study.loading import Config, DampingStudy


def deployable_of(config: Exportable, place: str) -> Deployable:
    """Return what a configuration is exported as: its estimator, its controller, or an arm's designer.

    Raises:
        InputError: it has neither, or one that no robot can run.
    """
    if isinstance(config, ArmStudy):
        return DeployableDesigner(config, place)
    if isinstance(config, DampingStudy):
        return DeployableController(config, place)
    if isinstance(config, Config) and config.kind != "damping":
        return DeployableEstimator(config)
    raise input_error(
        place,
        f"kind {config.kind!r} has nothing to export",
        "name a study or configuration with [estimator], a damping study with [controller], or an arm's study",
    )
