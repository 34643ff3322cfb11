"""The kernel of the antagonistic joint's estimator: the algebraic observer on both sides, T = 1 s."""

from __future__ import annotations

import math
from collections.abc import Sequence

import jax
import numpy as np

from tuning.bench.joints import MENARD_SUBSTEPS, problem_of
from tuning.bench.opponent import Opponent
from tuning.bench.recordings import Lanes, intervals_of, record_joints
from tuning.bench.workload import Kernel, Workload
from tuning.problem.build import number
from vsajax import Bench, rollout
from vsajax.estimators import windows
from vsajax.experiments import estimation

_WINDOW = 1.0
_SIDE = "estimator.side."
_FILTER = tuple(
    f"{_SIDE}velocity.{name}"
    for name in ("acceleration_variance", "reading_variance", "start_position_variance", "start_velocity_variance")
)


def responses_of(bench: Bench, sample_time: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the filters of position and torque, `(tap,)` with the newest sample first.

    With J, b, γ of the estimator: γ² (T b g″ − J g‴) and T² g′, both over T² ‖g′‖, by product quadrature.
    """
    inertia, damping, gear, window = (
        number(bench, _SIDE + name) for name in ("motor_inertia", "motor_damping", "gear_ratio", "window")
    )
    taps = windows.taps_of(float(window), sample_time)
    first, second, third = (
        windows.impulse_response(kernel, window, sample_time=sample_time, taps=taps, quadrature="product")
        for kernel in (windows.FIRST, windows.SECOND, windows.THIRD)
    )
    scale = 1.0 / (window**2 * windows.FIRST_NORM)
    on_position = scale * gear**2 * (window * damping * second - inertia * third)
    return np.asarray(on_position), np.asarray(scale * window**2 * first)


def _flops(samples: int, taps: int) -> float:
    """Count fast convolutions of both sides: five signals and two responses there, four sums back."""
    length = 1 << (samples + taps - 2).bit_length()
    transform = 2.5 * length * math.log2(length)
    return 2.0 * ((5 + 2 + 4) * transform / samples + 2 * 30.0 + 4.0 * 9 + 9.0 * 3 + 20.0)


def _prepare(lanes: int, settings: Sequence[str]) -> Workload:
    window = (f"{_SIDE}window={_WINDOW}", f"{_SIDE}longest_window={_WINDOW}", "clock.duration=4.0")
    problem = problem_of("antagonistic", [*window, *settings], MENARD_SUBSTEPS)
    bench, sample_time = problem.bench, problem.study.clock.sample_time
    time, recordings = record_joints(problem, "antagonistic", lanes)

    def observer(own: Lanes, shared: tuple[Bench, jax.Array]) -> jax.Array:
        bench, time = shared
        return estimation.score(bench.estimator, own.recording(time), own.stiffness, scorer=bench.scorer).msrep

    program = jax.jit(lambda own, shared: rollout.map_lanes(observer, own, shared))
    on_position, on_torque = (np.ascontiguousarray(c[::-1]) for c in responses_of(bench, sample_time))
    own_window = float(number(bench, f"{_SIDE}window"))
    constants = [float(number(bench, f"{_SIDE}{name}")) for name in ("gear_ratio", "basis.deflection_scale")]
    constants += [float(number(bench, f"{_SIDE}fit.prior_scale")), own_window / sample_time]
    constants += [math.sqrt(sample_time / own_window), *(float(number(bench, path)) for path in _FILTER)]
    constants.append(float(number(bench, "scorer.stiffness_floor")))
    numbers = [intervals_of(time), on_position, on_torque, *recordings.columns(), np.array(constants)]
    sizes, flops = [problem.samples, on_torque.size], _flops(problem.samples, on_torque.size)

    def twin(opponent: Opponent) -> np.ndarray:
        return opponent.call("algebraic", [lanes], sizes, numbers, (lanes,))

    return Workload(program, (recordings, (bench, time)), lanes, problem.samples, flops, twin)


KERNELS = (
    Kernel(
        "algebraic_observer",
        f"algebraic observer and fit, both sides, T = {_WINDOW:g} s",
        64,
        _prepare,
        0.2,
        "22 real transforms of 2.5 L log₂ L a recording; C convolves directly",
    ),
)
