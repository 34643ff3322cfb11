"""Which of its parts a configuration is exported for."""

from __future__ import annotations

from tuning.errors import input_error
from tuning.exports.controller import DeployableController
from tuning.exports.deployable import Deployable
from tuning.exports.estimator import DeployableEstimator
from tuning.study import Base, Config, DampingStudy


def deployable_of(config: Base, place: str) -> Deployable:
    """Return what a configuration is exported as: its estimator, or its controller.

    Raises:
        InputError: it has neither, or one that no robot can run.
    """
    if isinstance(config, DampingStudy):
        return DeployableController(config, place)
    if isinstance(config, Config) and config.kind != "damping":
        return DeployableEstimator(config)
    raise input_error(
        place,
        f"kind {config.kind!r} has nothing to export",
        "name a study or configuration with [estimator], or a damping study with [controller]",
    )
