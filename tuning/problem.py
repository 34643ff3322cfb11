"""A study made computable: the score of the bench at any values of its numbers, for any noise draw."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Key

from tuning.build import build_bench, with_leaves
from tuning.integration import check_substeps, choose_substeps, motion_of
from tuning.study import Study
from vsajax import Bench, Scores, Truth, experiment

Stream = Literal["train", "held_out"]
Values = Mapping[str, Float[Array, "..."]]

_STREAMS: dict[Stream, int] = {"train": 0, "held_out": 1}
_CLOCK, _NOISE = 0, 1


def scenario_keys(study: Study, stream: Stream, count: int) -> Key[Array, " scenario"]:
    """Return one key a scenario: the i-th is the same however many are drawn."""
    base = jax.random.fold_in(jax.random.key(study.seed), _STREAMS[stream])
    return jax.vmap(lambda i: jax.random.fold_in(base, i))(jnp.arange(count))


class Given(NamedTuple):
    """What a study's programs are given: as arguments, so that one compilation serves every value.

    Args:
        bench: the bench at the study's own numbers.
        truth: the motion that every scenario sees, or `None` where they differ.
    """

    bench: Bench
    truth: Truth | None


@dataclass(frozen=True)
class Problem:
    """A study's bench, and its scores as pure functions of varied numbers and scenario keys.

    Args:
        study: the study.
        varied: dotted paths of the numbers that will vary. Where none of them belongs to the joint, the
            excitation or an irregular clock, the motion is simulated once and shared.
    """

    study: Study
    varied: tuple[str, ...] = ()

    @cached_property
    def bench(self) -> Bench:
        """The bench at the study's own numbers."""
        return build_bench(self.study)

    @property
    def samples(self) -> int:
        """Number of samples of a recording."""
        return self.bench.clock.samples

    @property
    def shares_motion(self) -> bool:
        """Whether every scenario and value sees the same motion."""
        moves = any(path.startswith(("joint.", "excitation.")) for path in self.varied)
        return not moves and self.bench.clock.jitter_std is None

    @cached_property
    def substeps(self) -> int:
        """Integration steps a sample: the study's, or enough for its `integration_tolerance`."""
        study = self.study
        sample_time, tolerance = study.clock.sample_time, study.integration_tolerance
        if study.substeps is None:
            return choose_substeps(self.bench, sample_time, tolerance)
        check_substeps(self.bench, sample_time, study.substeps, tolerance)
        return study.substeps

    @cached_property
    def shared_truth(self) -> Truth | None:
        """The motion that every scenario sees, or `None` where they differ."""
        # Chosen ahead of any program: while one is traced, no motion can be run to choose it.
        substeps = self.substeps
        if not self.shares_motion:
            return None
        return motion_of(self.bench, substeps)

    @property
    def given(self) -> Given:
        """What `record`, `scores` and `residuals` are given."""
        return Given(self.bench, self.shared_truth)

    def record(self, key: Key[Array, ""], given: Given) -> tuple[Truth, experiment.Recording]:
        """Return the motion and its recording in the scenario of `key`."""
        truth = given.truth
        if truth is None:
            truth = experiment.simulate(given.bench, key=jax.random.fold_in(key, _CLOCK), substeps=self.substeps)
        return truth, experiment.measure(given.bench, truth, key=jax.random.fold_in(key, _NOISE))

    def scores(self, values: Values, key: Key[Array, ""], given: Given) -> Scores:
        """Return the scores at `values` in the scenario of `key`."""
        bench = with_leaves(given.bench, values)
        truth, recording = self.record(key, given._replace(bench=bench))
        return experiment.score(bench.estimator, recording, truth.motion.stiffness, scorer=bench.scorer)

    def residuals(self, values: Values, key: Key[Array, ""], given: Given) -> Float[Array, " time"]:
        """Return the vector whose squared norm is the scenario's objective [√%]."""
        bench = with_leaves(given.bench, values)
        truth, recording = self.record(key, given._replace(bench=bench))
        return experiment.residuals(
            bench.estimator,
            recording,
            truth.motion.stiffness,
            scorer=bench.scorer,
            settled=self.study.tune.objective == "msrep_settled",
        )
