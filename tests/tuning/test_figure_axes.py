"""Axes of pictures: scores and times on logarithmic scales, ticks that can be read, optima on an edge told."""

from __future__ import annotations

import math

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tuning.report.pictures import scores as pictures
from tuning.report.pictures.fronts import draw_front
from tuning.report.pictures.searches import draw_sweep
from tuning.scoring.sweep import say_edges
from tuning.search.blackbox import Trial, find_front

PRIOR, GAIN = "estimator.fit.prior_scale", "estimator.torque.observer_gain"


def _trials(times: np.ndarray, scores: np.ndarray) -> list[Trial]:
    return [Trial(i, {}, {}, float(s), float(t), 0.0) for i, (t, s) in enumerate(zip(times, scores, strict=True))]


def check_ticks(figure: Figure) -> None:
    """Check that every axis that shows something names two numbers at least, none of them over another."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    for axes in figure.axes:
        if axes.get_label() == "<colorbar>":
            continue
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
            named = [t.label1 for t in ticks if low <= t.get_loc() <= high and t.label1.get_text()]
            boxes = [label.get_window_extent() for label in named]
            assert len(boxes) >= 2
            upright = [box for box, label in zip(boxes, named, strict=True) if not label.get_rotation() % 90]
            for i, box in enumerate(upright):
                assert not any(box.overlaps(other) for other in upright[i + 1 :]), axes.get_xlabel()


@pytest.mark.parametrize("spread", [0.02, 0.3, 1.0, 4.0])
def test_a_front_has_logarithmic_axes_with_ticks_that_can_be_read(spread):
    rng = np.random.default_rng(0)
    times, scores = np.exp(spread * rng.normal(size=(2, 80)))
    trials = _trials(times, scores)
    for figure in (
        draw_front(trials, find_front(trials), "msrep"),
        pictures.draw_front(scores, times, "mean MSREP [%]"),
    ):
        (axes,) = figure.axes
        assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
        check_ticks(figure)
    assert draw_front(trials, find_front(trials), "log_energy").axes[0].get_ylabel().endswith("scenarios")


def test_a_score_that_is_zero_leaves_its_axis_linear():
    trials = _trials(np.array([0.0, 1.0]), np.array([1.0, 0.5]))
    (axes,) = draw_front(trials, find_front(trials), "msrep").axes
    assert (axes.get_xscale(), axes.get_yscale()) == ("linear", "log")


@pytest.mark.parametrize("points", [3, 31, 200])
def test_the_ticks_of_a_sweep_leave_room(points):
    axes = {PRIOR: list(np.geomspace(1e-3, 10.0, points)), GAIN: list(np.geomspace(10.0, 1e3, points))}
    rows = [{"configuration": i, "mean": 1.0 + i} for i in range(points**2)]
    figure = draw_sweep(rows, axes, "msrep")
    assert len(figure.axes[0].get_xticks()) <= 10
    check_ticks(figure)
    check_ticks(draw_sweep(rows[:points], {PRIOR: axes[PRIOR]}, "msrep"))


def test_an_optimum_on_the_grids_edge_is_told():
    axes = {PRIOR: [0.1, 1.0, 10.0], GAIN: [10.0, 100.0, 1000.0], "sensing.x": ["a", "b", "c"], "pair": [1.0, 2.0]}
    best = {"mean": 1.0, PRIOR: 10.0, GAIN: 100.0, "sensing.x": "a", "pair": 1.0}
    (said,) = say_edges(axes, best)
    assert said == f"the best lies on the grid's edge: {PRIOR} = 10 is its largest; add larger values"
    assert "is its smallest; add smaller" in say_edges(axes, best | {PRIOR: 0.1})[0]
    assert say_edges(axes, best | {PRIOR: 1.0}) == []
    assert say_edges(axes, best | {"mean": math.nan}) == []
