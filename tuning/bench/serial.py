"""Kernels of the serial joint's estimator: filters, residual torque, recursive least squares with d = 18."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from tuning.bench.joints import AWAS_SUBSTEPS, problem_of
from tuning.bench.opponent import Opponent
from tuning.bench.recordings import Lanes, intervals_of, record_joints
from tuning.bench.workload import Kernel, Workload
from tuning.kinds.estimation.problem import EstimationProblem
from tuning.problem.build import number, with_leaves
from tuning.problem.scenarios import draw_scenarios
from tuning.scoring.grid import Grid
from tuning.search.least_squares import LANES_PER_CHUNK
from vsajax import Bench, Scores, rollout
from vsajax.experiments import estimation
from vsajax.rollout import sensitivity

GAIN, PRIOR = "estimator.torque.observer_gain", "estimator.fit.prior_scale"
_FILTER = "estimator.velocity."
# In the order of the fields of the C structures.
_OWN = (GAIN, f"{_FILTER}acceleration_variance", f"{_FILTER}fast_variance", PRIOR)
_SETTINGS = (
    *(f"{_FILTER}{name}" for name in ("slow_variance", "sharpness", "counts_per_revolution")),
    *(f"{_FILTER}start_{name}_variance" for name in ("position", "velocity")),
    *(f"estimator.torque.{name}" for name in ("motor_inertia", "motor_damping", "gear_ratio")),
    "estimator.basis.deflection_scale",
)
TUNED = (*_OWN, f"{_FILTER}slow_variance", f"{_FILTER}sharpness")
"""The six hyperparameters of the gradient."""

_FEATURES = 18
_FILTERS, _RESIDUAL, _BASIS, _SCORE = 54.0, 16.0, 54.0, 4.0


def _fit_flops(d: int) -> float:
    # P F and P − K FᵀP are 2 d² each; leverage, innovation, coefficients and stiffness are dot products.
    return 4.0 * d * d + 9.0 * d


_ESTIMATOR = 2 * _FILTERS + _RESIDUAL + _BASIS + _fit_flops(_FEATURES) + _SCORE
_ALL_SCORES = _ESTIMATOR + 2.0 * _FEATURES**2 + 4.0 * _FEATURES + 60.0


def own_values(bench: Bench, lanes: int) -> dict[str, np.ndarray]:
    """Return `(lane,)` hyperparameters by path, spread over a factor of four about the study's."""
    generator = np.random.default_rng(1)
    return {path: float(number(bench, path)) * 2.0 ** generator.uniform(-1.0, 1.0, lanes) for path in _OWN}


def _settings(bench: Bench) -> np.ndarray:
    unit = 1000.0 if bench.estimator.basis.setpoint_unit == "mm" else 1.0  # pyright: ignore[reportAttributeAccessIssue]
    lever = [unit * float(number(bench, f"estimator.basis.setpoint_{name}")) for name in ("origin", "scale")]
    return np.array([*(float(number(bench, path)) for path in _SETTINGS), *lever])


_AS_PRINTED = "estimator.matched=false"
"""C computes the estimator of the paper; and its features, those of a sweep's lanes alike, are computed once."""


def _score(values: dict[str, jax.Array], own: Lanes, shared: tuple[Bench, jax.Array]) -> Scores:
    bench, time = shared
    estimator = with_leaves(bench, values).estimator
    return estimation.score(estimator, own.recording(time), own.stiffness, scorer=bench.scorer)


def _recorded(lanes: int, settings: Sequence[str], deflection: str) -> tuple[EstimationProblem, jax.Array, Lanes]:
    own = [f"estimator.deflection={deflection!r}", _AS_PRINTED, *settings]
    problem = problem_of("serial", own, AWAS_SUBSTEPS)
    return problem, *record_joints(problem, "serial", lanes)


def _independent(lanes: int, settings: Sequence[str], *, all_scores: bool) -> Workload:
    problem, time, recordings = _recorded(lanes, settings, "filtered")
    values = own_values(problem.bench, lanes)

    def estimator(own: tuple[dict[str, jax.Array], Lanes], shared: tuple[Bench, jax.Array]) -> Any:
        scores = _score(*own, shared)
        return scores if all_scores else scores.msrep

    program = jax.jit(lambda own, shared: rollout.map_lanes(estimator, own, shared))
    leaves = {path: jnp.asarray(column) for path, column in values.items()}
    arguments = ((leaves, recordings), (problem.bench, time))
    if all_scores:
        return Workload(program, arguments, lanes, problem.samples, _ALL_SCORES)
    parameters = np.ascontiguousarray(np.stack([values[path] for path in _OWN], axis=1))
    numbers = [intervals_of(time), *recordings.columns(), _settings(problem.bench), parameters]

    def twin(opponent: Opponent) -> np.ndarray:
        return opponent.call("serial", [lanes], [problem.samples], numbers, (lanes,))

    return Workload(program, arguments, lanes, problem.samples, _ESTIMATOR, twin)


def _gradient(lanes: int, settings: Sequence[str]) -> Workload:
    problem, time, recordings = _recorded(lanes, settings, "raw")
    z = jnp.log(jnp.stack([number(problem.bench, path) for path in TUNED]))

    def observe(own: Lanes, bench: Bench) -> estimation.Observed:
        return estimation.observe(own.recording(time), own.stiffness, scorer=bench.scorer)

    def mean_of(function: Callable[[Callable[..., sensitivity.Loop], jax.Array], jax.Array]) -> Any:
        def of_one(own: estimation.Observed, shared: tuple[jax.Array, Bench]) -> jax.Array:
            z, bench = shared

            def loop_at(z: jax.Array) -> sensitivity.Loop:
                values: dict[str, jax.Array] = dict(zip(TUNED, jnp.exp(z), strict=True))
                return estimation.residual_loop(with_leaves(bench, values).estimator, own, scorer=bench.scorer)

            return function(loop_at, z)

        def mean(own: estimation.Observed, shared: tuple[jax.Array, Bench]) -> jax.Array:
            return jnp.mean(rollout.map_lanes(of_one, own, shared, chunk=LANES_PER_CHUNK), axis=0)

        return jax.jit(mean)

    # Handed over ready, so that the program's memory is that of the recursion alone.
    observed = jax.jit(lambda own, bench: rollout.map_lanes(observe, own, bench))(recordings, problem.bench)
    gradient = mean_of(sensitivity.normal_equations)
    forward = mean_of(lambda loop_at, z: sensitivity.sum_of_squares(loop_at(z)))
    return Workload(gradient, (observed, (z, problem.bench)), lanes, problem.samples, base=forward)


PRIOR_SCALES, OBSERVER_GAINS, DRAWS = 8, 32, 64


def _sweep(lanes: int, settings: Sequence[str]) -> Workload:
    gains = np.geomspace(20.0, 1000.0, OBSERVER_GAINS)
    scales = np.geomspace(1e-3, 10.0, PRIOR_SCALES)
    draws = max(1, lanes // (OBSERVER_GAINS * PRIOR_SCALES))
    problem = problem_of("serial", ["estimator.deflection='raw'", _AS_PRINTED, *settings], AWAS_SUBSTEPS)
    axes = {PRIOR: scales.tolist(), GAIN: gains.tolist()}
    varied = EstimationProblem(problem.study, tuple(axes))
    grid = Grid(varied, axes, draws)

    # C computes this score alone; what else a sweep keeps is then not computed here either.
    program = jax.jit(lambda own, common: grid.program(own, common).msrep)
    scenarios = draw_scenarios(grid.problem.study, grid.stream, draws)
    truth, recorded = jax.jit(jax.vmap(varied.record, in_axes=(0, None)))(scenarios, varied.given)
    own = jax.tree.map(lambda x: x[0], recorded)
    signals = [np.ascontiguousarray(x) for x in (own.link_position, own.motor_position, own.setpoint_position)]
    numbers = [
        *(intervals_of(own.time), *signals, np.ascontiguousarray(recorded.motor_torque)),
        *(np.ascontiguousarray(truth.motion.stiffness[0]), _settings(problem.bench)),
        *(np.array([float(number(problem.bench, path)) for path in _OWN]), scales, gains),
    ]

    def twin(opponent: Opponent) -> np.ndarray:
        sizes = [PRIOR_SCALES, OBSERVER_GAINS, draws]
        return opponent.call("sweep", sizes, [problem.samples], numbers, tuple(sizes))

    count = PRIOR_SCALES * OBSERVER_GAINS * draws
    shared = _FILTERS + _BASIS + _fit_flops(_FEATURES)
    flops = _RESIDUAL + 6.0 * _FEATURES + _SCORE + shared / (OBSERVER_GAINS * draws)

    def arrange(msrep: Any) -> np.ndarray:
        return grid.arrange(msrep).reshape(PRIOR_SCALES, OBSERVER_GAINS, draws)

    arguments = grid.arguments(grid.outer_points)
    return Workload(program, arguments, count, problem.samples, flops, twin, arrange=arrange)


_COUNTED = f"4 d² + 9 d of the fit with d = {_FEATURES}, an exponential counts 24"
KERNELS = (
    Kernel(
        "serial_estimator",
        "serial estimator, d = 18, independent joints",
        256,
        partial(_independent, all_scores=False),
        0.8,
        f"{_ESTIMATOR:.0f} a sample: {_COUNTED}",
    ),
    Kernel(
        "serial_all_scores",
        "the same with every score",
        256,
        partial(_independent, all_scores=True),
        None,
        f"{_ALL_SCORES:.0f} a sample: the same and 2 d² of the posterior variance",
    ),
    Kernel(
        "sweep",
        f"sweep of {PRIOR_SCALES} κ × {OBSERVER_GAINS} K_I × {DRAWS} noise draws",
        PRIOR_SCALES * OBSERVER_GAINS * DRAWS,
        _sweep,
        0.15,
        "residual, three dot products and score a lane, the rest shared",
    ),
    Kernel(
        "gradient",
        f"JᵀJ and Jᵀr in {len(TUNED)} hyperparameters, against the forward run",
        256,
        _gradient,
        4.0,
        "not counted",
    ),
)
