"""A study of an estimator made computable: the bench is simulated, measured, estimated and scored."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Key

from tuning.kinds.estimation.study import EstimationStudy
from tuning.kinds.estimation.substeps import check_substeps, choose_substeps, rate_at_rest, try_substeps
from tuning.problem.build import build, with_leaves
from tuning.problem.interface import LANES, Outcome, Scenario, Status, Stream, Values
from tuning.problem.scenarios import draw_scenarios
from tuning.study.ranges import Reach
from vsajax import Bench, Recording, Truth
from vsajax.experiments import estimation
from vsajax.rollout.sensitivity import Loop

_CLOCK, _NOISE = 0, 1
_PROBED = 256


_COARSE = 0.25
"""ω h from which a motion counts as under-resolved: its oscillations' frequency is off by (ω h)²/24, 0.3 %."""


class Given(NamedTuple):
    """What a study's programs are given: as arguments, so that one compilation serves every value.

    Args:
        bench: the bench at the study's own numbers.
        truth: the motion that every scenario sees, or `None` where they differ.
    """

    bench: Bench
    truth: Truth | None


@dataclass(frozen=True)
class EstimationProblem:
    """A study's bench, and its scores as pure functions of varied numbers and scenarios.

    Args:
        study: the study.
        varied: dotted paths of the numbers that will vary, beside the population's. Where none of either belongs
            to the joint, the excitation or an irregular clock, the motion is simulated once and shared.
    """

    study: EstimationStudy
    varied: tuple[str, ...] = ()
    if_not_finite: ClassVar[tuple[str, str]] = ("joint", "check its springs, inertias and excitation")
    lanes: ClassVar[int] = LANES

    @cached_property
    def bench(self) -> Bench:
        """The bench at the study's own numbers."""
        tables = ("joint", "excitation", "sensing", "estimator", "scorer", "clock")
        return Bench(**{name: build(getattr(self.study, name)) for name in tables})

    @property
    def samples(self) -> int:
        """Number of samples of a recording."""
        return self.bench.clock.samples

    @property
    def shares_motion(self) -> bool:
        """Whether every scenario and value sees the same motion."""
        varied = (*self.varied, *self.study.population.paths)
        moves = any(Reach.MOTION in self.study.reach(path) for path in varied)
        return not moves and self.bench.clock.jitter_std is None

    @property
    def substeps(self) -> int:
        """Integration steps a sample: the study's, or enough for its `integration_tolerance`."""
        return self._substeps

    @cached_property
    def _substeps(self) -> int:
        study = self.study
        sample_time, tolerance = study.clock.sample_time, study.integration_tolerance
        if study.substeps is None:
            return max(choose_substeps(bench, sample_time, tolerance) for bench in self._demanding())
        check_substeps(self.bench, sample_time, study.substeps, tolerance)
        return study.substeps

    def _demanding(self) -> list[Bench]:
        """Return the bench, and beside it the one of some of the population with the fastest joint at rest."""
        if not any(path.startswith("joint.") for path in self.study.population.paths):
            return [self.bench]
        numbers = draw_scenarios(self.study, "population", _PROBED).numbers

        def rate(values: Values) -> Float[Array, ""]:
            return rate_at_rest(with_leaves(self.bench, values).joint)

        fastest = int(jnp.argmax(jax.vmap(rate)(numbers)))
        return [self.bench, with_leaves(self.bench, {path: values[fastest] for path, values in numbers.items()})]

    @cached_property
    def shared_truth(self) -> Truth | None:
        """The motion that every scenario sees, or `None` where they differ."""
        # Chosen ahead of any program: while one is traced, no motion can be run to choose it.
        substeps = self.substeps
        if not self.shares_motion:
            return None
        return try_substeps(self.bench, substeps).truth

    @property
    def given(self) -> Given:
        """What `record`, `outcome` and `residuals` are given."""
        return Given(self.bench, self.shared_truth)

    def scenarios(self, stream: Stream, count: int, start: int = 0) -> Scenario:
        """Return the scenarios `start`, `start` + 1, … of a stream, `(count,)`."""
        return draw_scenarios(self.study, stream, count, start)

    def columns(self, scenario: Scenario, given: Given) -> dict[str, Array]:
        """Return the recording of a scenario and its truth by name, each `(time,)`."""
        truth, recording = self.record(scenario, given)
        signals = {name: value for name, value in recording._asdict().items() if value is not None}
        motion = truth.motion
        return signals | {"true_stiffness": motion.stiffness, "true_elastic_torque": motion.elastic_torque}

    def record(self, scenario: Scenario, given: Given) -> tuple[Truth, Recording]:
        """Return the motion and its recording in a scenario."""
        return self._record(with_leaves(given.bench, scenario.numbers), scenario.key, given.truth)

    def _record(self, bench: Bench, key: Key[Array, ""], shared: Truth | None) -> tuple[Truth, Recording]:
        truth = shared
        if truth is None:
            truth = estimation.simulate(bench, key=jax.random.fold_in(key, _CLOCK), substeps=self.substeps)
        return truth, estimation.measure(bench, truth, key=jax.random.fold_in(key, _NOISE))

    def outcome(self, values: Values, scenario: Scenario, given: Given) -> Outcome:
        """Return the scores at `values` in a scenario, and whether they count."""
        bench = with_leaves(given.bench, {**scenario.numbers, **values})
        truth, recording = self._record(bench, scenario.key, given.truth)
        stiffness = truth.motion.stiffness
        scores = estimation.score(bench.estimator, recording, stiffness, scorer=bench.scorer)
        step = self.study.clock.sample_time / self.substeps
        is_finite = jnp.all(jnp.isfinite(stiffness)) & jnp.all(jnp.isfinite(truth.motion.link_position))
        is_coarse = jnp.max(bench.joint.fastest_rate(stiffness)) * step > _COARSE
        status = jnp.where(scores.diverged > 0, Status.ESTIMATE_DIVERGED, Status.OK)
        status = jnp.where(is_coarse, Status.STEP_TOO_COARSE, status)
        return Outcome(scores, jnp.where(is_finite, status, Status.MOTION_DIVERGED))

    def observe(self, values: Values, scenario: Scenario, given: Given) -> estimation.Observed:
        """Return what is recorded at `values` in a scenario, with its truth."""
        bench = with_leaves(given.bench, {**scenario.numbers, **values})
        truth, recording = self._record(bench, scenario.key, given.truth)
        settled = self.study.tune.objective == "msrep_settled"
        return estimation.observe(recording, truth.motion.stiffness, scorer=bench.scorer, settled=settled)

    def residuals(
        self, values: Values, scenario: Scenario, given: Given, observed: estimation.Observed | None
    ) -> Loop:
        """Return the loop whose residuals' squares sum to the scenario's objective [%]."""
        bench = with_leaves(given.bench, {**scenario.numbers, **values})
        seen = self.observe(values, scenario, given) if observed is None else observed
        return estimation.residual_loop(bench.estimator, seen, scorer=bench.scorer)
