"""The controller of a damping study as it runs on a robot: encoder reading in, command out."""

from __future__ import annotations

from collections.abc import Mapping

import jax
import numpy as np

from tuning.exports.deployable import Deployable, nothing_to_export
from tuning.files.errors import input_error
from tuning.kinds.damping.problem import simulate_exchange
from tuning.kinds.damping.study import DampingStudy
from tuning.kinds.estimation.deployable import sample_of
from tuning.problem.build import build
from tuning.study.base import Base, resolved
from tuning.study.loading import parse_study
from tuning.study.parts.base import Part
from vsajax import Recording, Sample
from vsajax.control import ObservedController


class DeployableController(Deployable):
    """Observer and controller of one joint.

    Args:
        study: the study.
        place: its source, for errors.

    Raises:
        InputError: the study has no sensor: its controller saw velocities that no robot measures.
    """

    noun = "controller"

    def __init__(self, study: DampingStudy, place: str):
        if study.sensor is None:
            raise input_error(
                f"{place}: sensor",
                "is missing: the controller was given the true motion, which no robot measures",
                "add a [sensor] table, e.g. --set sensor.noise_std=0.0, and an [observer], and judge it so",
            )
        self.study = study

    @property
    def config(self) -> DampingStudy:
        """The study."""
        return self.study

    @property
    def title(self) -> str:
        """What it is, for people."""
        return f"damping controller ({self.study.controller.tag}) of one joint, with its observer"

    @property
    def parts(self) -> Mapping[tuple[str, ...], Part]:
        """The tables of controller and observer."""
        return {("controller",): self.study.controller, ("observer",): self.study.observer}

    def build(self) -> ObservedController:
        """Return observer and controller."""
        return ObservedController(build(self.study.controller), build(self.study.observer))

    @property
    def sample(self) -> Sample:
        """Time step, link and motor position."""
        return sample_of(("link_position", "motor_position"))

    @property
    def sample_time(self) -> float:
        """The loop's [s]."""
        return self.study.clock.sample_time

    def simulate(self, seconds: float) -> tuple[dict[str, np.ndarray], str]:
        """Return what the sensor read in the study's own closed loop."""
        tables = resolved(self.study) | {"sweep": {}, "tune": {}}
        tables["clock"] = tables["clock"] | {"duration": seconds}
        study = parse_study(tables, "golden recording")
        assert isinstance(study, DampingStudy)
        recording = simulate_exchange(study, 0).recording
        columns = {name: getattr(recording, name) for name in Recording._fields if name in recording.present()}
        source = f"what the sensor read in the closed loop of {study.name!r}, scenario 0"
        return jax.tree.map(np.asarray, columns), source


def deployable_of(config: Base, place: str) -> DeployableController:
    """Return the controller of a damping study; an estimator alone is none.

    Raises:
        InputError: there is no controller, or one that no robot can run.
    """
    if not isinstance(config, DampingStudy):
        raise nothing_to_export(config, place)
    return DeployableController(config, place)
