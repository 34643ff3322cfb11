"""What an estimator makes of a log over time: the torque that is explained, and the line that explains it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import jax
import numpy as np
from matplotlib.figure import Figure

from tuning.kinds.log.agreement import agreement_of
from tuning.kinds.log.problem import LogProblem
from tuning.kinds.log.study import LogStudy
from tuning.pictures.page import Picture, number
from tuning.pictures.style import ESTIMATE, OTHER, QUIET, new_figure, thin
from tuning.problem.interface import Stream

_POINTS = 4000


def show_agreement(
    study: LogStudy,
    stream: Stream,
    shown: Sequence[int],
    *,
    of: str,
    cases: Mapping[int, str],
) -> Iterator[Picture]:
    """Show torque and deflection over the whole log, the held-out part marked.

    Args:
        study: with the log.
        stream: both parts of the log are shown.
        shown: a part is one scenario.
        of: what the titles add.
        cases: none.
    """
    del stream, shown, cases
    problem = LogProblem(study)
    torque, lagging = (np.asarray(x) for x in jax.jit(problem.signals)({}, problem.given))
    time, train = np.asarray(problem.given.recording.time), np.asarray(problem.given.is_training)
    held_out = agreement_of(torque, lagging, lagging, ~train)
    line = agreement_of(torque, lagging, lagging, train).stiffness * (lagging - lagging[train].mean())
    line += torque[train].mean()
    until = study.recording.train_until
    yield Picture(
        f"Torque over time{of}",
        _draw_time(time, torque, line, until),
        f"The line over the deflection, lagging as the torque does, is fitted up to {until:g} s. Grey: held out.",
        f"Torque over {number(float(time[-1]))} s. Held out, its rms is {number(held_out.rms)} N·m and its "
        f"correlation with the deflection {number(held_out.correlation)}.",
    )
    if np.ptp(lagging) > 0.0:
        yield Picture(
            f"Torque over deflection{of}",
            _draw_loop(lagging, torque, train),
            "Where both parts lie on one line, the numbers hold beyond what they were tuned on.",
            f"Torque over deflection; the held-out part's slope is {number(held_out.stiffness)} N·m/rad.",
        )


def _draw_time(time: np.ndarray, torque: np.ndarray, line: np.ndarray, until: float) -> Figure:
    figure, axis = new_figure(6.4, 3.6)
    kept = thin(np.arange(time.size), _POINTS)
    axis.plot(time[kept], torque[kept], color=ESTIMATE, linewidth=0.9, label="torque")
    axis.plot(time[kept], line[kept], "--", color=OTHER, linewidth=0.9, label="line over the deflection")
    axis.axvspan(until, float(time[-1]), color=QUIET, alpha=0.2, linewidth=0, label="held out")
    axis.set_xlabel("time [s]")
    axis.set_ylabel("torque [N·m]")
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, fontsize=8)
    return figure


def _draw_loop(deflection: np.ndarray, torque: np.ndarray, train: np.ndarray) -> Figure:
    figure, axis = new_figure(6.4, 3.8)
    for chosen, colour, label in ((train, QUIET, "training"), (~train, ESTIMATE, "held out")):
        kept = thin(np.flatnonzero(chosen), _POINTS)
        axis.plot(
            1e3 * deflection[kept], torque[kept], ".", color=colour, markersize=2, label=label, rasterized=True
        )
    axis.set_xlabel("deflection, as the torque lags [mrad]")
    axis.set_ylabel("torque [N·m]")
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, fontsize=8, markerscale=4)
    return figure
