"""A study made computable: the score of the bench at any values of its numbers, in any scenario."""

from __future__ import annotations

import enum
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Key

from tuning.kinds.estimation.substeps import check_substeps, choose_substeps, rate_at_rest, try_substeps
from tuning.problem.build import build_bench, with_leaves
from tuning.study.loading import EstimationStudy, Study, numeric_paths
from vsajax import Bench, Recording, Scores, SwingScores, Truth, experiment, sensitivity

Stream = Literal["train", "held_out", "population", "sensitivity"]
Values = Mapping[str, Float[Array, "..."]]
Vector = Float[Array, " p"]

_STREAMS: dict[Stream, int] = {"train": 0, "held_out": 1, "population": 2, "sensitivity": 3}
_CLOCK, _NOISE = 0, 1
_PROBED = 256


class Scenario(NamedTuple):
    """What tells one scenario from another, or `(scenario,)` of them.

    Args:
        key: of the clock's jitter and the sensors' noise.
        numbers: the population's numbers by path.
    """

    key: Key[Array, "..."]
    numbers: dict[str, Float[Array, "..."]]


class Status(enum.IntEnum):
    """How a scenario ended: only the scores of an `OK` one count."""

    OK = 0
    MOTION_DIVERGED = 1
    STEP_TOO_COARSE = 2
    ESTIMATE_DIVERGED = 3

    @property
    def reason(self) -> str:
        """What happened, for people."""
        return _REASONS[self]


_REASONS = {
    Status.OK: "scored",
    Status.MOTION_DIVERGED: "the simulated motion is not finite",
    Status.STEP_TOO_COARSE: "the joint is too stiff for the study's integration steps: set `substeps`",
    Status.ESTIMATE_DIVERGED: "an estimate is not finite",
}
_COARSE = 0.25
"""ω h from which a motion counts as under-resolved: its oscillations' frequency is off by (ω h)²/24, 0.3 %."""


class Outcome(NamedTuple):
    """A scenario's scores, and whether they count.

    Args:
        scores: its scores.
        status: a `Status`.
    """

    scores: Scores | SwingScores
    status: Float[Array, "..."]


def stream_key(study: Study, stream: Stream) -> Key[Array, ""]:
    """Return the key from which a stream's scenarios are drawn."""
    return _key(study.seed, _STREAMS[stream])


def draw_scenarios(study: Study, stream: Stream, count: int, start: int = 0) -> Scenario:
    """Return the scenarios `start`, `start` + 1, …: each is the same however many are drawn.

    Args:
        study: its seed and population.
        stream: scenarios of one stream are independent of those of the others.
        count: how many.
        start: number of the first.
    """
    keys = _keys(stream_key(study, stream), start, count)
    shares = study.population.shares((study.seed, _STREAMS[stream]), start, count)
    numbers = study.population.values(shares, numeric_paths(study))
    return Scenario(keys, {path: jnp.asarray(values) for path, values in numbers.items()})


@jax.jit
def _key(seed: int, stream: int) -> Key[Array, ""]:
    return jax.random.fold_in(jax.random.key(seed), stream)


@partial(jax.jit, static_argnames="count")
def _keys(base: Key[Array, ""], start: int, count: int) -> Key[Array, " count"]:
    return jax.vmap(partial(jax.random.fold_in, base))(start + jnp.arange(count))


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
    """A study's bench, and its scores as pure functions of varied numbers and scenarios.

    Args:
        study: the study.
        varied: dotted paths of the numbers that will vary, beside the population's. Where none of either belongs
            to the joint, the excitation or an irregular clock, the motion is simulated once and shared.
    """

    study: EstimationStudy
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
        varied = (*self.varied, *self.study.population.paths)
        moves = any(path.startswith(("joint.", "excitation.")) for path in varied)
        return not moves and self.bench.clock.jitter_std is None

    @cached_property
    def substeps(self) -> int:
        """Integration steps a sample: the study's, or enough for its `integration_tolerance`."""
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
        """What `record`, `scores` and `residual_loop` are given."""
        return Given(self.bench, self.shared_truth)

    def record(self, scenario: Scenario, given: Given) -> tuple[Truth, Recording]:
        """Return the motion and its recording in a scenario."""
        return self._record(with_leaves(given.bench, scenario.numbers), scenario.key, given.truth)

    def _record(self, bench: Bench, key: Key[Array, ""], shared: Truth | None) -> tuple[Truth, Recording]:
        truth = shared
        if truth is None:
            truth = experiment.simulate(bench, key=jax.random.fold_in(key, _CLOCK), substeps=self.substeps)
        return truth, experiment.measure(bench, truth, key=jax.random.fold_in(key, _NOISE))

    def scores(self, values: Values, scenario: Scenario, given: Given) -> Scores:
        """Return the scores at `values` in a scenario."""
        bench = with_leaves(given.bench, {**scenario.numbers, **values})
        truth, recording = self._record(bench, scenario.key, given.truth)
        return experiment.score(bench.estimator, recording, truth.motion.stiffness, scorer=bench.scorer)

    def outcome(self, values: Values, scenario: Scenario, given: Given) -> Outcome:
        """Return the scores at `values` in a scenario, and whether they count."""
        bench = with_leaves(given.bench, {**scenario.numbers, **values})
        truth, recording = self._record(bench, scenario.key, given.truth)
        stiffness = truth.motion.stiffness
        scores = experiment.score(bench.estimator, recording, stiffness, scorer=bench.scorer)
        step = self.study.clock.sample_time / self.substeps
        is_finite = jnp.all(jnp.isfinite(stiffness)) & jnp.all(jnp.isfinite(truth.motion.link_position))
        is_coarse = jnp.max(bench.joint.fastest_rate(stiffness)) * step > _COARSE
        status = jnp.where(scores.diverged > 0, Status.ESTIMATE_DIVERGED, Status.OK)
        status = jnp.where(is_coarse, Status.STEP_TOO_COARSE, status)
        return Outcome(scores, jnp.where(is_finite, status, Status.MOTION_DIVERGED))

    def observe(self, values: Values, scenario: Scenario, given: Given) -> experiment.Observed:
        """Return what is recorded at `values` in a scenario, with its truth."""
        bench = with_leaves(given.bench, {**scenario.numbers, **values})
        truth, recording = self._record(bench, scenario.key, given.truth)
        settled = self.study.tune.objective == "msrep_settled"
        return experiment.observe(recording, truth.motion.stiffness, scorer=bench.scorer, settled=settled)

    def residual_loop(
        self, values: Values, scenario: Scenario, given: Given, observed: experiment.Observed | None
    ) -> sensitivity.Loop:
        """Return the loop whose residuals' squares sum to the scenario's objective [%].

        Args:
            values: numbers by path.
            scenario: one scenario.
            given: the study's own numbers.
            observed: what `observe` returns, where `values` do not change it, or `None`.
        """
        bench = with_leaves(given.bench, {**scenario.numbers, **values})
        seen = self.observe(values, scenario, given) if observed is None else observed
        return experiment.residual_loop(bench.estimator, seen, scorer=bench.scorer)

    def objective(
        self, values: Values, scenario: Scenario, given: Given, observed: experiment.Observed | None
    ) -> Float[Array, ""]:
        """Return the scenario's objective [%], see `residual_loop`."""
        return sensitivity.sum_of_squares(self.residual_loop(values, scenario, given, observed))

    def normal_equations(
        self,
        values_at: Callable[[Vector], Values],
        z: Vector,
        scenario: Scenario,
        given: Given,
        observed: experiment.Observed | None,
    ) -> Float[Array, "q q"]:
        """Return MᵀM of M = [J r], the residuals r and their derivatives J = ∂r/∂z at `values_at(z)`."""

        def loop_at(z: Vector) -> sensitivity.Loop:
            return self.residual_loop(values_at(z), scenario, given, observed)

        return sensitivity.normal_equations(loop_at, z)
