"""Kernels that integrate joints, each lane with parameters of its own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np

from tuning.bench.opponent import Opponent
from tuning.bench.workload import Kernel, Workload
from tuning.files.shipped import example_path
from tuning.kinds.estimation.problem import EstimationProblem
from tuning.kinds.estimation.study import load_estimation
from tuning.problem.build import number, with_leaves
from vsajax import Bench, rollout
from vsajax.experiments import estimation

Kind = Literal["serial", "antagonistic"]

# In the order of the fields of the C structures.
AWAS = tuple(
    f"joint.{path}"
    for path in (
        *("link.inertia", "link.damping", "motor.inertia", "motor.damping", "motor.gear_ratio"),
        *("setpoint_motor.inertia", "setpoint_motor.damping", "setpoint_motor.gear_ratio"),
        *("spring.spring_rate", "spring.arm", "spring.pitch", "setpoint_start", "start"),
    )
)
MENARD = tuple(
    f"joint.{path}"
    for path in (
        *("link.inertia", "link.damping", "motor1.inertia", "motor1.damping", "motor1.gear_ratio"),
        *("motor2.inertia", "motor2.damping", "motor2.gear_ratio"),
        *("spring1.linear", "spring1.cubic", "spring2.linear", "spring2.cubic"),
    )
)
# Gear ratios, lever geometry and start stay: a population's spread of 10 % must not carry a lever through zero.
_KEPT = ("gear_ratio", "start", "arm", "pitch", "linear")


def problem_of(kind: Kind, settings: Sequence[str], substeps: int) -> EstimationProblem:
    """Return the shipped study of a kind, shortened to what the bench needs.

    Args:
        kind: of the joint.
        settings: that replace its values.
        substeps: integration steps a sample.
    """
    lean = ["sweep={}", "tune={}", f"substeps={substeps}", "clock.duration=2.0"]
    return EstimationProblem(load_estimation(example_path(kind, kind), [*lean, *settings]))


def spread(bench: Bench, paths: Sequence[str], lanes: int, *, seed: int = 0) -> dict[str, np.ndarray]:
    """Return `(lane,)` values within ±10 % of the bench's own, by path; gear ratios and geometry stay."""
    generator = np.random.default_rng(seed)
    values = {}
    for path in paths:
        own = float(number(bench, path))
        shares = generator.uniform(0.9, 1.1, lanes)
        values[path] = np.full(lanes, own) if path.endswith(_KEPT) else own * shares
    return values


def _prepare(
    kind: Kind, paths: tuple[str, ...], substeps: int, flops: float, lanes: int, settings: Sequence[str]
) -> Workload:
    problem = problem_of(kind, settings, substeps)
    bench, values = problem.bench, spread(problem.bench, paths, lanes)

    def plant(own: dict[str, jax.Array], shared: Bench) -> jax.Array:
        joint = with_leaves(shared, own)
        motion = estimation.simulate(joint, key=jax.random.key(0), substeps=substeps).motion
        return jnp.stack([jnp.mean(motion.stiffness), motion.link_position[-1]])

    @jax.jit
    def program(own: dict[str, jax.Array], shared: Bench) -> jax.Array:
        return rollout.map_lanes(plant, own, shared)

    step = problem.study.clock.sample_time / substeps
    time = problem.study.clock.sample_time * np.arange(problem.samples)
    torques = bench.excitation.torques(jnp.asarray(time[:, None] + step * (np.arange(substeps) + 0.5)))
    driven = torques[:2] if kind == "serial" else torques[3:]
    numbers: list[Any] = [step, *(np.ascontiguousarray(torque) for torque in driven)]
    numbers.append(np.ascontiguousarray(np.stack([values[path] for path in paths], axis=1)))

    def twin(opponent: Opponent) -> np.ndarray:
        name = "awas_plant" if kind == "serial" else "antagonistic_plant"
        return opponent.call(name, [lanes], [problem.samples, substeps], numbers, (lanes, 2))

    leaves = {path: jnp.asarray(column) for path, column in values.items()}
    return Workload(program, (leaves, bench), lanes, problem.samples, flops, twin)


AWAS_SUBSTEPS, MENARD_SUBSTEPS = 4, 21
"""What the shipped studies choose for themselves."""

KERNELS = (
    Kernel(
        "awas_plant",
        f"AwAS plant, {AWAS_SUBSTEPS} steps a sample",
        512,
        lambda lanes, settings: _prepare(
            "serial", AWAS, AWAS_SUBSTEPS, 33.0 + 70.0 * AWAS_SUBSTEPS, lanes, settings
        ),
        0.5,
        "70 a step and 33 a sample, of which a sine counts 24",
    ),
    Kernel(
        "antagonistic_plant",
        f"antagonistic plant, {MENARD_SUBSTEPS} steps a sample",
        256,
        lambda lanes, settings: _prepare(
            "antagonistic", MENARD, MENARD_SUBSTEPS, 11.0 + 45.0 * MENARD_SUBSTEPS, lanes, settings
        ),
        0.5,
        "45 a step and 11 a sample",
    ),
)
