"""A study made computable: the score of the bench at any values of its numbers, for any noise draw."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Key

from tuning.build import build_bench, with_leaves
from tuning.study import Study
from vsajax import Bench, Scores, Truth, experiment, plants

Stream = Literal["train", "held_out"]
Values = Mapping[str, Float[Array, "..."]]

_STREAMS: dict[Stream, int] = {"train": 0, "held_out": 1}
_CLOCK, _NOISE = 0, 1


def scenario_keys(study: Study, stream: Stream, count: int) -> Key[Array, " scenario"]:
    """Return one key a scenario: the i-th is the same however many are drawn."""
    base = jax.random.fold_in(jax.random.key(study.seed), _STREAMS[stream])
    return jax.vmap(lambda i: jax.random.fold_in(base, i))(jnp.arange(count))


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
        """Integration steps a sample: the study's, or enough to resolve the stiffest moment of its motion."""
        if self.study.substeps is not None:
            return self.study.substeps
        joint, sample_time = self.bench.joint, self.study.clock.sample_time
        start = joint.observe(joint.rest(), plants.Torques.none())
        substeps = plants.substeps_for(float(joint.fastest_rate(start.stiffness)), sample_time)
        while True:
            # The stiffness along the way is only known once simulated; a stiffer moment asks for finer steps.
            truth = self._simulate_motion(self.bench, jax.random.key(0), substeps)
            rates = joint.fastest_rate(truth.motion.stiffness)
            fastest = float(jnp.max(jnp.where(jnp.isfinite(rates), rates, jnp.inf)))
            if not math.isfinite(fastest):
                raise FloatingPointError(
                    f"the simulated joint diverges with {substeps} integration steps a sample; "
                    "check its parameters, or set `substeps` in the study"
                )
            needed = plants.substeps_for(fastest, sample_time)
            if needed <= substeps:
                return substeps
            substeps = needed

    @staticmethod
    def _simulate_motion(bench: Bench, key: Key[Array, ""], substeps: int) -> Truth:
        return jax.jit(experiment.simulate, static_argnames="substeps")(bench, key=key, substeps=substeps)

    @cached_property
    def shared_truth(self) -> Truth | None:
        """The motion that every scenario sees, or `None` where they differ."""
        # Chosen ahead of any program: while one is traced, no motion can be run to choose it.
        substeps = self.substeps
        if not self.shares_motion:
            return None
        return self._simulate_motion(self.bench, jax.random.key(0), substeps)

    def record(
        self, bench: Bench, key: Key[Array, ""], shared: Truth | None
    ) -> tuple[Truth, experiment.Recording]:
        """Return the motion and its recording in the scenario of `key`."""
        truth = shared
        if truth is None:
            truth = experiment.simulate(bench, key=jax.random.fold_in(key, _CLOCK), substeps=self.substeps)
        return truth, experiment.measure(bench, truth, key=jax.random.fold_in(key, _NOISE))

    def scores(self, values: Values, key: Key[Array, ""], shared: Truth | None) -> Scores:
        """Return the scores at `values` in the scenario of `key`; `shared` is `shared_truth`."""
        bench = with_leaves(self.bench, values)
        truth, recording = self.record(bench, key, shared)
        return experiment.score(bench.estimator, recording, truth.motion.stiffness, scorer=bench.scorer)

    def residuals(self, values: Values, key: Key[Array, ""], shared: Truth | None) -> Float[Array, " time"]:
        """Return the vector whose squared norm is the scenario's objective [√%]."""
        bench = with_leaves(self.bench, values)
        truth, recording = self.record(bench, key, shared)
        return experiment.residuals(
            bench.estimator,
            recording,
            truth.motion.stiffness,
            scorer=bench.scorer,
            settled=self.study.tune.objective == "msrep_settled",
        )
