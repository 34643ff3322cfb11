"""A damping study made computable: a controller in the loop, simulated and scored."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array

from tuning.kinds.damping.study import DampingStudy
from tuning.problem.build import build, with_leaves
from tuning.problem.interface import LANES, Outcome, Scenario, Status, Stream, Values
from tuning.problem.replay import replayed, require_finite
from tuning.problem.scenarios import draw_scenarios
from vsajax import ControlLoop, SwingMotion
from vsajax.experiments import damping
from vsajax.experiments.damping import Exchange
from vsajax.rollout.sensitivity import Loop


@dataclass(frozen=True)
class DampingProblem:
    """A study's closed loop, and its scores as pure functions of varied numbers and scenarios.

    Args:
        study: the study.
        varied: dotted paths of the numbers that will vary, beside the population's.
    """

    study: DampingStudy
    varied: tuple[str, ...] = ()
    if_not_finite: ClassVar[tuple[str, str]] = ("controller", "check its gains, or set `substeps`")
    lanes: ClassVar[int] = LANES

    @cached_property
    def bench(self) -> ControlLoop:
        """The loop at the study's own numbers."""
        tables = ("plant", "impact", "controller", "scorer", "clock", "sensor", "observer", "start")
        return ControlLoop(**{name: build(getattr(self.study, name)) for name in tables})

    @property
    def samples(self) -> int:
        """Number of samples of a run."""
        return self.bench.clock.samples

    @property
    def substeps(self) -> int:
        """Integration steps a sample."""
        return self.study.substeps

    @property
    def given(self) -> ControlLoop:
        """What `outcome` and `residuals` are given: one compilation serves every value."""
        return self.bench

    def motion(self, scenario: Scenario, given: ControlLoop) -> SwingMotion:
        """Return the motion in a scenario."""
        loop = with_leaves(given, scenario.numbers)
        return damping.simulate(loop, key=scenario.key, substeps=self.substeps)

    def scenarios(self, stream: Stream, count: int, start: int = 0) -> Scenario:
        """Return the scenarios `start`, `start` + 1, … of a stream, `(count,)`."""
        return draw_scenarios(self.study, stream, count, start)

    def columns(self, scenario: Scenario, given: ControlLoop) -> dict[str, Array]:
        """Return the motion of a scenario by name, each `(time,)`."""
        motion = self.motion(scenario, given)
        return {
            "time": motion.time,
            "link_position": motion.positions[0],
            "link_velocity": motion.velocities[0],
            "motor_position": motion.motor_positions[0],
            "true_stiffness": motion.stiffness[0],
            "commanded_stiffness": motion.commanded[0],
        }

    def observe(self, values: Values, scenario: Scenario, given: ControlLoop) -> None:
        """Return nothing: a controller changes all that is recorded."""
        del values, scenario, given

    def exchange(self, scenario: Scenario, given: ControlLoop) -> Exchange:
        """Return what the joint's controller was told in a scenario, and what it answered."""
        loop = with_leaves(given, scenario.numbers)
        return damping.exchanges(loop, key=scenario.key, substeps=self.substeps)[0]

    def outcome(self, values: Values, scenario: Scenario, given: ControlLoop) -> Outcome:
        """Return the scores at `values` in a scenario, and whether they count."""
        loop = with_leaves(given, {**scenario.numbers, **values})
        scores = damping.score(loop, key=scenario.key, substeps=self.substeps)
        return Outcome(scores, jnp.where(scores.diverged > 0, Status.MOTION_DIVERGED, Status.OK))

    def residuals(self, values: Values, scenario: Scenario, given: ControlLoop, observed: object) -> Loop:
        """Return the loop whose residuals' squares sum to the scenario's `log_energy`."""
        loop = with_leaves(given, {**scenario.numbers, **values})
        return damping.residual_loop(loop, key=scenario.key, substeps=self.substeps)


def simulate_exchange(study: DampingStudy, scenario: int) -> Exchange:
    """Return what the controller was told in a scenario's loop, and what it answered.

    Args:
        study: what is simulated.
        scenario: its number, as `problem.replay.simulate` has it.

    Raises:
        InputError: the motion is not finite.
    """
    problem = DampingProblem(study)
    exchange = problem.exchange(replayed(study, scenario), problem.given)
    require_finite(exchange, *problem.if_not_finite)
    return exchange
