"""Throughput of the kernels: compile and run time apart, warm, minimum of several runs.

Run with `make bench`. Machines are noisy: compare the rows of one run, not the same row of two.
"""

from __future__ import annotations

from tuning.runtime import start_jax

start_jax()

import time  # noqa: E402
from collections.abc import Callable  # noqa: E402
from typing import Any  # noqa: E402

import equinox as eqx  # noqa: E402
import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402

from tuning.cli.options import table  # noqa: E402
from tuning.grid import Grid  # noqa: E402
from tuning.problem import Problem, draw_scenarios  # noqa: E402
from tuning.resources import example_path  # noqa: E402
from tuning.study import Study, load_study  # noqa: E402
from vsajax import experiment, rollout  # noqa: E402

REPEATS = 5
LANES = (64, 512, 2048)
Row = tuple[str, int, float, float]


def measure(program: Callable[..., Any], *arguments: Any, steps: int) -> tuple[float, float]:
    """Return seconds to compile (and run once), and nanoseconds per step of the fastest of several runs."""
    start = time.perf_counter()
    jax.block_until_ready(program(*arguments))
    compiled = time.perf_counter() - start
    runs = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        jax.block_until_ready(program(*arguments))
        runs.append(time.perf_counter() - start)
    return compiled - min(runs), 1e9 * min(runs) / steps


def bench_plant(study: Study, lanes: int) -> Row:
    """Time AwAS joints of different link inertia."""
    problem = Problem(study)
    substeps = problem.substeps

    def plant(inertia: jax.Array, _: None) -> jax.Array:
        bench = eqx.tree_at(lambda b: b.joint.link.inertia, problem.bench, inertia)
        motion = experiment.simulate(bench, key=jax.random.key(0), substeps=substeps).motion
        return motion.stiffness[-1]

    program = jax.jit(lambda inertias: rollout.map_lanes(plant, inertias))
    inertias = jnp.linspace(0.05, 0.2, lanes)
    return f"AwAS plant, {substeps} substeps", lanes, *measure(program, inertias, steps=lanes * problem.samples)


def bench_estimator(study: Study, lanes: int) -> Row:
    """Time estimators with a filter variance of their own: nothing of the covariance is shared."""
    problem = Problem(study)
    drawn = jax.tree.map(lambda x: x[0], draw_scenarios(study, "train", 1))

    def estimator(variance: jax.Array, given: Any) -> jax.Array:
        return problem.scores({"estimator.velocity.acceleration_variance": variance}, drawn, given).msrep

    program = jax.jit(lambda variances, given: rollout.map_lanes(estimator, variances, given))
    variances = jnp.geomspace(1e8, 1e10, lanes)
    seconds = measure(program, variances, problem.given, steps=lanes * problem.samples)
    return "residual estimator, d = 18, nothing shared", lanes, *seconds


def bench_algebraic(window: float, lanes: int) -> Row:
    """Time the algebraic observer over recordings of antagonistic joints, for a window T [s]."""
    settings = [
        "sweep={}",
        "tune={}",
        f"estimator.side.window={window}",
        f"estimator.side.longest_window={window}",
    ]
    problem = Problem(load_study(example_path("antagonistic", "antagonistic"), settings))
    drawn = draw_scenarios(problem.study, "train", lanes)
    given = problem.given
    record = jax.jit(jax.vmap(lambda scenario: problem.record(scenario, given)[1]))
    recordings = jax.block_until_ready(record(drawn))

    def observer(recording: Any, given: Any) -> jax.Array:
        return experiment.estimate(given.bench.estimator, recording).stiffness[-1]

    program = jax.jit(lambda recordings, given: rollout.map_lanes(observer, recordings, given, chunk=16))
    seconds = measure(program, recordings, given, steps=lanes * problem.samples)
    return f"algebraic observer, both sides, T = {window} s", lanes, *seconds


def bench_sweep(study: Study) -> Row:
    """Time a grid whose torque-only axes share the covariance."""
    axes = {
        "estimator.torque.observer_gain": list(np.geomspace(20, 1000, 8)),
        "estimator.fit.prior_scale": list(np.geomspace(1e-3, 10, 8)),
    }
    grid = Grid(Problem(study, tuple(axes)), axes, 64)
    steps = grid.configurations * grid.scenarios * grid.problem.samples
    seconds = measure(grid.program, *grid.arguments(grid.outer_points), steps=steps)
    return "sweep, 8 K_I × 8 κ × 64 noise draws", grid.configurations * grid.scenarios, *seconds


def main() -> None:
    """Print one row a kernel and number of lanes."""
    jax.config.update("jax_enable_compilation_cache", False)
    study = load_study(example_path("serial", "serial"), ["clock.duration=2.0", 'estimator.deflection="filtered"'])
    rows = [bench_plant(study, lanes) for lanes in LANES]
    rows += [bench_estimator(study, lanes) for lanes in LANES]
    rows.append(bench_sweep(study))
    rows += [bench_algebraic(window, 1000) for window in (0.1, 1.0, 2.0)]
    print(table(["kernel", "lanes", "compile [s]", "run [ns per lane-step]"], rows))


if __name__ == "__main__":
    main()
