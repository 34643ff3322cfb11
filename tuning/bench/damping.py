"""Kernels of closed loops: law (23) tilted, a slow actuator, and every score, each lane a robot of its own."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import jax
import jax.numpy as jnp

from tuning.bench.workload import Kernel, Workload
from tuning.files.shipped import example_path
from tuning.kinds.damping.problem import DampingProblem
from tuning.kinds.damping.study import DampingStudy
from tuning.problem.build import with_leaves
from tuning.problem.scenarios import draw_scenarios
from tuning.study.loading import load_study
from vsajax import ControlLoop, rollout
from vsajax.experiments import damping

_CONTROLLER = "controller={type='switch', soft=0.3, stiff=1.0, rule={type='conic', lead=0.03, slope=9.0}}"
_MECHANICAL = ("plant.mechanism.link.inertia", "impact.impulse", "plant.actuator.travel_time")
_LONGEST = 250.0
"""10,000 loops of 4 s at 1 kHz in 10 s [ns]."""


def problem_of(settings: Sequence[str], *, sensed: bool) -> DampingProblem:
    """Return the shipped study under a conic rule; without `sensed` the controller is told the true motion."""
    lean = ["sweep={}", "tune={}", _CONTROLLER, "sensor.longest_delay=5"]
    study = load_study(example_path("damping", "damping"), [*lean, *settings])
    assert isinstance(study, DampingStudy)
    return DampingProblem(study if sensed else study.model_copy(update={"sensor": None}))


def _prepare(lanes: int, settings: Sequence[str], *, sensed: bool) -> Workload:
    problem = problem_of(settings, sensed=sensed)
    drawn = draw_scenarios(problem.study, "population", lanes)
    own = drawn.numbers if sensed else {path: drawn.numbers[path] for path in _MECHANICAL}

    def one(lane: tuple[dict[str, jax.Array], jax.Array], shared: ControlLoop) -> jax.Array:
        numbers, key = lane
        scores = damping.score(with_leaves(shared, numbers), key=key, substeps=problem.substeps)
        return jnp.stack(list(scores))

    program = jax.jit(lambda lanes, shared: rollout.map_lanes(one, lanes, shared))
    return Workload(program, ((own, drawn.key), problem.bench), lanes, problem.samples)


KERNELS = (
    Kernel(
        "damping_loop",
        "closed loop, conic rule, true state",
        2048,
        partial(_prepare, sensed=False),
        None,
        "not counted",
        _LONGEST,
    ),
    Kernel(
        "damping_loop_sensed",
        "the same with encoder, noise, delay and velocity filter",
        2048,
        partial(_prepare, sensed=True),
        None,
        "not counted",
        _LONGEST,
    ),
)
