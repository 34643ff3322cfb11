"""What errors in the joints' stiffness leave of the hand's, scenario by scenario.

A mechanism is set to the designed stiffness as far as somebody estimated it: the joint really has k (1 + e). The
controller was designed for k, so that the hand's compliance is C_a + J diag(c / (1 + e)) Jᵀ instead of C_s.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from tuning.files.errors import input_error
from tuning.kinds.arm.bench import USABLE, ArmBench, Joints, build_bench
from tuning.kinds.arm.study import ArmStudy
from tuning.problem.interface import LANES, Outcome, Scenario, Status, Stream, Values
from tuning.problem.scenarios import draw_scenarios
from tuning.runs.folder import read_results
from tuning.runs.sealed import read_table
from vsajax.compliance import stiffness_errors

MSREP = "msrep"
"""The level of a scenario among its numbers [%]; NaN stands for that of another run's robots."""
_POSE, _ERRORS, _ROBOTS = range(3)
_LEAST = 0.05
"""No joint is left with less than this share of its stiffness, whatever the draw."""
_SAMPLES = 128
"""Of a simple joint's simulation, which take as long as one design."""


class ArmScores(NamedTuple):
    """How far off a hand is, relative; NaN where no design can be used.

    Args:
        stiffness_error: of the hand's stiffness from the desired one.
        compliance_error: the same as compliances.
        stiffness_change: from the designed one: what the joints' errors do, apart from an offset that the design
            has without them.
        diverged: 1 where the others are NaN, else 0.
    """

    stiffness_error: Float[Array, "..."]
    compliance_error: Float[Array, "..."]
    stiffness_change: Float[Array, "..."]
    diverged: Float[Array, "..."]


class Given(NamedTuple):
    """What `outcome` is given.

    Args:
        bench: the numbers of the arm, its task and its design.
        robots: MSREP of another run's robots, NaN of those that failed; `None` without such a run [%].
    """

    bench: ArmBench
    robots: Float[Array, " robots"] | None


@dataclass(frozen=True)
class ArmProblem:
    """An arm whose joints are not as stiff as they are believed to be.

    Args:
        study: the study.
        varied: dotted paths of the numbers that will vary, beside the population's.

    Raises:
        InputError: a URDF, or the run that `accuracy.run` names, cannot be read.
    """

    study: ArmStudy
    varied: tuple[str, ...] = ()
    lanes: ClassVar[int] = LANES

    def __post_init__(self) -> None:
        """Read what the study names, so that what is wrong with it is told before anything is written."""
        _ = self.given

    @cached_property
    def bench(self) -> ArmBench:
        """The bench at the study's own numbers."""
        return build_bench(self.study, "study")

    @property
    def samples(self) -> int:
        """How much work a scenario is, counted in samples of a joint's simulation."""
        return _SAMPLES

    @cached_property
    def given(self) -> Given:
        """What `outcome` is given: one compilation serves every value."""
        return Given(eqx.filter(self.bench, eqx.is_array), _robots_of(self.study))

    def scenarios(self, stream: Stream, count: int, start: int = 0) -> Scenario:
        """Return the scenarios `start`, `start` + 1, … of a stream, each draw at every level in turn."""
        levels = self.study.levels
        numbers = start + np.arange(count)
        first, last = numbers[0] // len(levels), numbers[-1] // len(levels)
        draws = draw_scenarios(self.study, stream, int(last - first + 1), int(first))
        own = jax.tree.map(lambda x: x[numbers // len(levels) - first], draws)
        return Scenario(own.key, own.numbers | {MSREP: jnp.asarray(levels)[numbers % len(levels)]})

    def outcome(self, values: Values, scenario: Scenario, given: Given) -> Outcome:
        """Return the scores at `values` in a scenario, and whether they count."""
        bench = eqx.combine(given.bench, self.bench)
        drawn = {path: value for path, value in scenario.numbers.items() if path != MSREP}
        bench = bench.with_values({**drawn, **values})
        low, high = bench.ranges.T
        positions = jax.random.uniform(_part(scenario, _POSE), low.shape, minval=low, maxval=high)
        msrep = self._msrep(scenario, given, low.shape)
        # MSREP is the mean square of relative errors, in %.
        errors = jax.random.normal(_part(scenario, _ERRORS), low.shape) * jnp.sqrt(msrep / 100.0)
        scores, is_usable = _score(bench, positions, errors)
        status = jnp.where(is_usable, Status.OK, Status.NO_DESIGN)
        return Outcome(scores, jnp.where(jnp.isnan(msrep).any(), Status.ESTIMATE_DIVERGED, status))

    def _msrep(self, scenario: Scenario, given: Given, shape: tuple[int, ...]) -> Joints:
        """Return the MSREP of each joint [%]: the level, or that of a robot of its own from another run."""
        level = jnp.broadcast_to(scenario.numbers[MSREP], shape)
        if given.robots is None:
            return level
        chosen = jax.random.choice(_part(scenario, _ROBOTS), given.robots, shape)
        return jnp.where(jnp.isnan(level), chosen, level)


def _part(scenario: Scenario, number: int) -> Array:
    return jax.random.fold_in(scenario.key, number)


def _score(bench: ArmBench, positions: Joints, errors: Joints) -> tuple[ArmScores, Array]:
    """Return how far off the hand is, and whether the pose has a design that can be used."""
    design = bench.design(positions)
    actual = bench.passive(positions, design.joint_compliance / jnp.maximum(1.0 + errors, _LEAST))
    found = stiffness_errors(design.active + actual, design.desired)
    change = stiffness_errors(design.active + actual, design.serial)
    scores = jnp.stack([found.stiffness, found.compliance, change.stiffness])
    is_usable = jnp.isin(design.status, jnp.asarray(USABLE)) & jnp.isfinite(scores).all()
    blank = jnp.where(is_usable, 1.0, jnp.nan)
    stiffness, compliance, changed = scores * blank
    return ArmScores(stiffness, compliance, changed, jnp.where(is_usable, 0.0, 1.0)), is_usable


def _robots_of(study: ArmStudy) -> Array | None:
    """Return the MSREP of the robots of the run that a study names [%], NaN of those that failed."""
    if study.accuracy.run is None:
        return None
    place, folder = "study: accuracy.run", study.folder / study.accuracy.run
    file = folder / "results.parquet"
    if not file.is_file():
        raise input_error(place, f"{folder} is no finished run", "name a folder that `vsajax montecarlo` wrote")
    try:
        table = read_results(folder) if (folder / "manifest.json").exists() else read_table(file)
        values = np.asarray(table["msrep_settled"], float)
    except (KeyError, TypeError) as error:
        problem = f"{file} has no column msrep_settled ({error})"
        raise input_error(place, problem, "name a run of an estimator") from None
    values = np.where(np.isfinite(values), values, np.nan)
    if np.isnan(values).all():
        raise input_error(place, f"{file} has no finite msrep_settled", "its robots all failed; mend that run")
    return jnp.asarray(values)
