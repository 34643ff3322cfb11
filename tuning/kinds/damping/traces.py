"""Closed loops of a damping study run again, for what they look like over time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import jax
import numpy as np

from tuning.kinds.damping.problem import DampingProblem
from tuning.kinds.damping.study import DampingStudy
from tuning.pictures.page import Picture, number
from tuning.pictures.style import ESTIMATE, TRUTH, new_figure
from tuning.problem.interface import Scenario, Stream
from tuning.problem.scenarios import numbered_scenarios
from vsajax import ControlLoop, rollout

_POINTS = 400
_LANES = 8


def show_swings(
    study: DampingStudy,
    stream: Stream,
    shown: Sequence[int],
    *,
    of: str,
    cases: Mapping[int, str],
) -> Iterator[Picture]:
    """Show where links are over time: bands over some scenarios, and over some others.

    Args:
        study: whose scenarios are run again.
        stream: of the scenarios.
        shown: numbers of those in the first picture.
        of: what its title adds.
        cases: titles of the scenarios in the second, by their number.
    """
    yield _show_swings(study, stream, shown, f"Coming to rest{of}")
    if cases:
        yield _show_swings(study, stream, list(cases), f"The worst robots: {'; '.join(cases.values())}")


def _show_swings(study: DampingStudy, stream: Stream, numbers: Sequence[int], title: str) -> Picture:
    problem = DampingProblem(study)
    scenarios = numbered_scenarios(study, stream, numbers)
    kept = np.unique(np.linspace(0, problem.samples - 1, _POINTS).astype(int))

    def one(scenario: Scenario, given: ControlLoop) -> tuple[jax.Array, jax.Array]:
        motion = problem.motion(scenario, given)
        return motion.positions[0][kept], motion.stiffness[0][kept]

    run = jax.jit(lambda lanes, shared: rollout.map_lanes(one, lanes, shared, chunk=_LANES))
    positions, stiffness = (np.asarray(trace) for trace in run(scenarios, problem.given))
    time = kept * study.clock.sample_time
    figure, axes = new_figure(5.6, 5.0, 2, sharex=True, height_ratios=(2, 1))
    for axis, traces, label in zip(
        axes, (positions, stiffness), ("position [rad]", "stiffness [N·m/rad]"), strict=True
    ):
        low, middle, high = np.nanquantile(traces, [0.05, 0.5, 0.95], axis=0)
        axis.fill_between(time, low, high, color=ESTIMATE, alpha=0.25, linewidth=0, label="5–95 %")
        axis.plot(time, middle, color=ESTIMATE, label="median")
        axis.plot(time, traces[0], color=TRUTH, linewidth=0.8, label=f"scenario {numbers[0]}")
        axis.set_ylabel(label)
    axes[0].legend(loc="upper right", fontsize=8)
    axes[1].set_xlabel("time after the impact [s]")
    late = np.abs(positions[:, time >= 0.8 * time[-1]]).max(axis=1)
    return Picture(
        title,
        figure,
        f"{len(numbers)} scenarios, simulated again for this report; bands hold 90 % of them.",
        f"Position and stiffness over {number(float(time[-1]))} s; in the last fifth the link moves by "
        f"{number(float(np.median(late)))} rad in half of them.",
    )
