"""The estimator of a study or of a configuration without a joint."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path as File

import jax
import jax.numpy as jnp
import numpy as np

from tuning.exports.deployable import Deployable, nothing_to_export
from tuning.exports.flatten import flatten
from tuning.files.shipped import example_path
from tuning.files.toml import read_toml
from tuning.kinds.estimation.study import EstimationStudy, observers_of, require_regular_clock
from tuning.problem.build import build_estimator
from tuning.problem.replay import simulate
from tuning.study.base import Base, Config, resolved
from tuning.study.loading import parse_study
from tuning.study.parts.base import Part
from tuning.study.parts.estimators import AlgebraicObserver
from vsajax import Sample
from vsajax.estimators import AbstractEstimator

_SETPOINT = "setpoint_position"


class DeployableEstimator(Deployable):
    """A stiffness estimator.

    Args:
        config: its configuration.
    """

    noun = "estimator"

    def __init__(self, config: Config):
        self._config = config

    @property
    def config(self) -> Config:
        """The configuration."""
        return self._config

    @property
    def title(self) -> str:
        """What it is, for people."""
        return f"stiffness estimator of a joint of kind {self.config.kind}"

    @property
    def parts(self) -> Mapping[tuple[str, ...], Part]:
        """The estimator's tables."""
        return {(): self.config.estimator}

    def build(self) -> AbstractEstimator:
        """Return the estimator."""
        return build_estimator(self.config)

    @property
    def sample(self) -> Sample:
        """The signals that it reads."""
        return sample_of(inputs_of(self.module))

    @property
    def sample_time(self) -> float | None:
        """That of its windows, or of the study's clock [s]."""
        if self._observers:
            return self._observers[0].sample_time
        return self.config.clock.sample_time if isinstance(self.config, EstimationStudy) else None

    @property
    def needs_regular_clock(self) -> bool:
        """Whether it has a window of samples."""
        return bool(self._observers)

    @property
    def _observers(self) -> list[AlgebraicObserver]:
        return [observer for _, observer in observers_of(self.config.estimator, "estimator")]

    def simulate(self, seconds: float) -> tuple[dict[str, np.ndarray], str]:
        """Return the signals of a study's own joint, or of the example joint where there is none."""
        study = self._study(seconds)
        return simulate(study, 0)[0], f"simulated from {study.name!r}, scenario 0"

    def record(self, path: File) -> tuple[dict[str, np.ndarray], str]:
        """Return `time` and the signals of the user's recording; one that is irregular is refused by a window."""
        columns, source = super().record(path)
        require_regular_clock(self.config, columns["time"], source)
        return columns, source

    def _study(self, seconds: float) -> EstimationStudy:
        if isinstance(self.config, EstimationStudy):
            tables = resolved(self.config)
        else:
            tables = read_toml(example_path(self.config.kind, "kind"))
            for name, value in self.sample._asdict().items():
                if value is not None and name not in {"dt", "deflection"}:
                    tables["sensing"].setdefault(name, {})
            if self.sample_time is not None:
                tables["clock"] = {"sample_time": self.sample_time}
                sides = [tables["estimator"], *(v for v in tables["estimator"].values() if isinstance(v, dict))]
                for side in sides:
                    if "sample_time" in side:
                        side["sample_time"] = self.sample_time
        tables |= {"sweep": {}, "tune": {}, "scorer": {}}
        tables["clock"] = tables["clock"] | {"duration": seconds}
        study = parse_study(tables, "golden recording")
        assert isinstance(study, EstimationStudy)
        return study


def inputs_of(estimator: AbstractEstimator) -> tuple[str, ...]:
    """Return the signals that an estimator reads, in the order of a sample.

    A nominal law may read the setpoint without which it could also run, so `needs` does not name it.
    """
    names = estimator.needs | {_SETPOINT}
    traced = jax.make_jaxpr(estimator.step, return_shape=False)
    sample = sample_of(names)
    flat = flatten(traced(jax.eval_shape(estimator.init, sample), sample))
    read = {i - len(flat.inputs) for i in flat.used()}
    present = [name for name in Sample._fields if name == "dt" or name in names]
    reads_setpoint = _SETPOINT in present and present.index(_SETPOINT) - len(present) in read
    return tuple(n for n in Sample._fields if n in estimator.needs or (n == _SETPOINT and reads_setpoint))


def sample_of(names: frozenset[str] | tuple[str, ...]) -> Sample:
    """Return a sample of zeros with some signals."""
    zero = jnp.zeros(())
    return Sample(zero, **{name: zero for name in Sample._fields if name in names})


def deployable_of(config: Base, place: str) -> DeployableEstimator:
    """Return the estimator of a study, or of a configuration without a joint.

    Raises:
        InputError: there is no estimator.
    """
    if not isinstance(config, Config):
        raise nothing_to_export(config, place)
    return DeployableEstimator(config)
