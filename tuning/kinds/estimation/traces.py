"""Scenarios of a study run again, for what they look like over time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tuning.kinds.estimation.problem import EstimationProblem, Given
from tuning.kinds.estimation.study import EstimationStudy
from tuning.pictures.page import Picture, number
from tuning.pictures.style import ESTIMATE, TRUTH, WIDTH, new_figure, quantiles
from tuning.problem.build import with_leaves
from tuning.problem.interface import Scenario, Stream
from tuning.problem.scenarios import numbered_scenarios
from vsajax import rollout
from vsajax.experiments import estimation

_POINTS = 400
"""Samples kept of a trace: a picture shows no more."""
_LANES = 8
"""Scenarios at a time on a device: whole recordings are held."""
_STREAMS = {
    "population": "robots of the population",
    "held_out": "held-out noise draws",
    "train": "training noise draws",
    "sensitivity": "robots of the design",
}


@dataclass(frozen=True)
class Replay:
    """Thinned traces, `(scenario, time)`.

    Args:
        time: [s].
        truth: true stiffness [N·m/rad].
        estimate: estimated stiffness [N·m/rad].
        known: whether the estimator says that it knows it.
    """

    time: np.ndarray
    truth: np.ndarray
    estimate: np.ndarray
    known: np.ndarray

    def part(self, rows: slice) -> Replay:
        """Return some of the scenarios."""
        return Replay(self.time[rows], self.truth[rows], self.estimate[rows], self.known[rows])


def replay(study: EstimationStudy, stream: Stream, numbers: Sequence[int]) -> Replay:
    """Run the scenarios of a stream with given numbers again."""
    problem = EstimationProblem(study)
    scenarios = numbered_scenarios(study, stream, numbers)
    kept = np.unique(np.linspace(0, problem.samples - 1, _POINTS).astype(int))

    def one(scenario: Scenario, given: Given) -> tuple[jax.Array, ...]:
        truth, recording = problem.record(scenario, given)
        answer = estimation.estimate(with_leaves(given.bench, scenario.numbers).estimator, recording)
        traces = (truth.time, truth.motion.stiffness, answer.stiffness, answer.known)
        return tuple(jnp.asarray(trace)[kept] for trace in traces)

    given = problem.given
    run = jax.jit(lambda lanes, shared: rollout.map_lanes(one, lanes, shared, chunk=_LANES))
    return Replay(*(np.asarray(trace) for trace in run(scenarios, given)))


_GREY = "#e4e4e4"


def show_estimates(
    study: EstimationStudy,
    stream: Stream,
    shown: Sequence[int],
    *,
    of: str,
    cases: Mapping[int, str],
) -> Iterator[Picture]:
    """Show true and estimated stiffness over time: bands over some scenarios, and some others one by one.

    Args:
        study: whose scenarios are run again.
        stream: of the scenarios.
        shown: numbers of those in the bands.
        of: what the title adds.
        cases: titles of single scenarios by their number.
    """
    traces = replay(study, stream, [*shown, *cases])
    yield _show_band(traces.part(slice(0, len(shown))), f"True and estimated stiffness{of}", _STREAMS[stream])
    if cases:
        yield Picture(
            "The worst robots",
            draw_cases(traces.part(slice(len(shown), None)), list(cases.values())),
            f"The {len(cases)} robots with the largest {study.tune.objective}, over time; grey: not known.",
            f"Stiffness over time, one panel each: {'; '.join(cases.values())}.",
        )


def _show_band(traces: Replay, title: str, scenarios: str) -> Picture:
    truth = quantiles(traces.truth)[1]
    estimate = np.where(traces.known, traces.estimate, np.nan)[:, -1]
    end = float(np.median(estimate[np.isfinite(estimate)])) if np.isfinite(estimate).any() else np.nan
    low, high = number(float(np.nanmin(truth))), number(float(np.nanmax(truth)))
    return Picture(
        title,
        draw_band(traces),
        f"{len(traces.time)} {scenarios}, simulated again for this report; "
        "bands hold 90 % of them. Grey: not known in most of them.",
        f"Stiffness over {number(float(traces.time.max()))} s. True median: {low} to {high} N·m/rad; "
        f"true at the end {number(float(truth[-1]))}, estimated {number(end)}. Below, the relative error.",
    )


def draw_band(replay: Replay) -> Figure:
    """Draw true against estimated stiffness, and the relative error: medians and 90 % bands over scenarios."""
    time = np.median(replay.time, axis=0)
    estimate = np.where(replay.known & np.isfinite(replay.estimate), replay.estimate, np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        error = 100 * np.abs(estimate - replay.truth) / np.abs(replay.truth)
    figure, (top, bottom) = new_figure(WIDTH, 5.0, 2, sharex=True, height_ratios=(3, 2))
    low, middle, high = quantiles(replay.truth)
    top.plot(time, middle, "--", color=TRUTH, label="true, median", zorder=3)
    if np.nanmax(high - low, initial=0.0) > 1e-6 * np.nanmax(np.abs(middle), initial=0.0):
        for edge, label in ((low, "true, 5–95 %"), (high, None)):
            top.plot(time, edge, ":", color=TRUTH, linewidth=0.9, label=label)
    below, centre, above = quantiles(estimate)
    top.fill_between(time, below, above, color=ESTIMATE, alpha=0.25, linewidth=0, label="estimated, 5–95 %")
    top.plot(time, centre, color=ESTIMATE, label="estimated, median")
    _limit(top, [low, high, _inner(centre)])
    below, centre, above = (np.where(line > 0, line, np.nan) for line in quantiles(error))
    bottom.fill_between(time, below, above, color=ESTIMATE, alpha=0.25, linewidth=0)
    bottom.plot(time, centre, color=ESTIMATE)
    if np.isfinite(centre).any():
        bottom.set_yscale("log")
    for axis in (top, bottom):
        _shade(axis, time, np.mean(replay.known, axis=0) < 0.5, "not known in most")
    top.set_ylabel("stiffness [N·m/rad]")
    bottom.set_ylabel("relative error [%]")
    bottom.set_xlabel("time [s]")
    top.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, fontsize=8)
    figure.align_ylabels()
    return figure


def draw_cases(replay: Replay, titles: Sequence[str]) -> Figure:
    """Draw true and estimated stiffness of single scenarios, one below the other."""
    count = len(titles)
    figure, axes = new_figure(WIDTH, 1.45 * count + 0.7, count, squeeze=False, sharex=True)
    for i, (axis, title) in enumerate(zip(axes[:, 0], titles, strict=True)):
        time, known = replay.time[i], replay.known[i]
        shown = np.where(known & np.isfinite(replay.estimate[i]), replay.estimate[i], np.nan)
        axis.plot(time, shown, color=ESTIMATE, label="estimated")
        axis.plot(time, replay.truth[i], "--", color=TRUTH, label="true")
        _limit(axis, [replay.truth[i], _inner(shown)])
        _shade(axis, time, ~known, "not known")
        axis.set_title(title, fontsize=8.5, loc="left")
        axis.set_ylabel("[N·m/rad]", fontsize=8)
    axes[-1, 0].set_xlabel("time [s]")
    lines, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(lines, labels, loc="outside upper center", ncols=3, fontsize=8)
    return figure


def _inner(values: np.ndarray) -> np.ndarray:
    """Return the bulk of a curve: a transient may be orders of magnitude away."""
    finite = values[np.isfinite(values)]
    return np.quantile(finite, [0.03, 0.97]) if finite.size else finite


def _limit(axis: Axes, pieces: Sequence[np.ndarray]) -> None:
    together = np.concatenate([piece[np.isfinite(piece)] for piece in pieces])
    if together.size:
        low, high = together.min(), together.max()
        room = 0.08 * (high - low) + 0.02 * max(abs(low), abs(high)) or 1.0
        axis.set_ylim(low - room, high + room)


def _shade(axis: Axes, time: np.ndarray, where: np.ndarray, label: str) -> None:
    place = axis.get_xaxis_transform()
    axis.fill_between(
        time, 0, 1, where=where, transform=place, color=_GREY, step="mid", linewidth=0, label=label, zorder=0
    )
