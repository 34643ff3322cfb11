"""Every picture: labelled axes, a legend where lines are several, and no warning on the way to a file."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from matplotlib.figure import Figure

from tests.tuning.builders import FORGETTING, GAIN, PRIOR
from tuning.files.errors import InputError
from tuning.kinds.estimation.pictures import draw_recording
from tuning.kinds.log.answer import Answer
from tuning.kinds.log.pictures import draw_estimate
from tuning.logs.clock import ClockReport
from tuning.logs.reading import RecordingTable
from tuning.logs.signal_map import canonical_map
from tuning.pictures.style import save
from tuning.report.pictures.searches import draw_sweep, draw_tuning

TIME = np.linspace(0.0, 1.0, 50)
SIGNALS = {
    "time": TIME,
    "link_position": np.sin(TIME),
    "motor_position": 0.9 * np.sin(TIME),
    "setpoint_position": TIME,
    "motor_torque": np.cos(TIME),
    "elastic_torque": np.cos(3 * TIME),
}
TRUTH = {"true_stiffness": 50.0 + TIME, "true_elastic_torque": np.cos(3 * TIME)}
DEFLECTION = {"time": TIME, "deflection": np.sin(TIME), "elastic_torque": np.cos(TIME)}
AXES = {GAIN: [10.0, 100.0, 1000.0], PRIOR: [0.1, 1.0], FORGETTING: [0.9, 0.99, 0.999, 1.0]}


def reads_well(figure: Figure, tmp_path) -> bytes:
    """Check labels and legends, write the figure, and return the file."""
    assert figure.axes
    for axis in figure.axes:
        assert axis.get_ylabel()
        place = axis.get_subplotspec()
        is_above_another = place is not None and not place.is_last_row() and axis.get_shared_x_axes()
        is_colour_bar = axis.get_label() == "<colorbar>"
        assert axis.get_xlabel() or is_above_another or is_colour_bar
        named = [line for line in axis.get_lines() if not line.get_label().startswith("_")]
        drawn = [line for line in axis.get_lines() if len(line.get_xdata()) > 2]
        if len(drawn) > 1:
            assert len(named) >= len(drawn)
            assert axis.get_legend() is not None
    path = save(figure, tmp_path / "figures" / "picture.png")
    written = path.read_bytes()
    assert written.startswith(b"\x89PNG")
    return written


def table_of(columns: dict[str, np.ndarray]) -> RecordingTable:
    """Return columns as a recording read from a canonical log."""
    signal_map = canonical_map("sea", {"deflection", "elastic_torque"})
    return RecordingTable(columns, "sea", "log.csv", (), signal_map, ClockReport(1e-3, 1e-3, (), 0.0))


@pytest.mark.parametrize("columns", [SIGNALS | TRUTH, SIGNALS, DEFLECTION], ids=["simulated", "serial", "sea"])
def test_a_recording_is_drawn_signal_by_signal(columns, tmp_path):
    figure = draw_recording(columns, title="rec")
    shown = set(columns) - {"time", "true_elastic_torque"} | {"deflection"}
    assert len(figure.axes) == len(shown)
    reads_well(figure, tmp_path)
    assert figure.axes[-1].get_xlabel() == "time [s]"
    assert all("[" in axis.get_ylabel() for axis in figure.axes)


KNOWN = {
    "from the middle": TIME > 0.5,
    "always": TIME >= 0.0,
    "never": TIME < 0.0,
}


@pytest.mark.parametrize("truth", [{}, TRUTH], ids=["measured", "simulated"])
@pytest.mark.parametrize("known", KNOWN)
def test_an_estimate_is_drawn_with_its_band_and_what_is_not_known(known, truth, tmp_path):
    columns = {
        "time": TIME,
        "stiffness": 50.0 + np.sin(9 * TIME),
        "stiffness_std": np.where(TIME < 0.1, np.inf, 1.0),
        "elastic_torque": np.cos(TIME),
        "torque": np.cos(TIME) + 0.01,
        "deflection": 1e-3 * np.sin(TIME),
        "known": KNOWN[known],
    }
    table = table_of(DEFLECTION | truth)
    figure = draw_estimate(Answer(columns, {}, []), table, title="log.csv")
    reads_well(figure, tmp_path)
    legend = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert {"estimate", "± 2 std of the fit", "not known"} <= set(legend)
    assert ("true" in legend) == bool(truth)
    # The view holds the bulk of the curve, whatever the transient was.
    low, high = figure.axes[0].get_ylim()
    assert 40.0 < low < 50.0 < high < 60.0


@pytest.mark.parametrize("value", [np.nan, 0.0])
def test_an_estimate_that_is_not_finite_or_never_moved_is_drawn_all_the_same(value, tmp_path):
    nothing = np.full_like(TIME, value)
    columns = {name: nothing for name in ("stiffness", "stiffness_std", "elastic_torque", "torque")}
    columns |= {"time": TIME, "deflection": TIME, "known": TIME < 0.0}
    table = table_of(DEFLECTION)
    reads_well(draw_estimate(Answer(columns, {}, []), table, title="log.csv"), tmp_path)


def rows_of(axes, mean) -> list[dict[str, float]]:
    points = itertools.product(*axes.values())
    rows = [{"configuration": n, **dict(zip(axes, p, strict=True)), "mean": mean(n)} for n, p in enumerate(points)]
    return rows[::-1]


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("diverged", ["none", "some", "all"])
def test_a_sweep_is_drawn_over_every_pair_of_axes(count, diverged, tmp_path):
    axes = dict(list(AXES.items())[:count])
    mean = {
        "none": lambda n: 1.0 + n,
        "some": lambda n: np.nan if n % 2 else 1.0 + n,
        "all": lambda _: np.nan,
    }[diverged]
    figure = draw_sweep(rows_of(axes, mean), axes, "msrep")
    reads_well(figure, tmp_path)
    labels = [(axis.get_xlabel(), axis.get_ylabel()) for axis in figure.axes if axis.get_xlabel()]
    if count == 1:
        assert labels == [(GAIN, "mean MSREP [%]")]
    else:
        assert labels == [(b, a) for a, b in itertools.combinations(axes, 2)]


def test_the_star_of_a_sweep_is_on_the_best_configuration(tmp_path):
    axes = {GAIN: AXES[GAIN], PRIOR: AXES[PRIOR]}
    # Configuration 3 is the second gain with the second prior.
    figure = draw_sweep(rows_of(axes, lambda n: 1.0 + abs(n - 3)), axes, "msrep")
    (star,) = figure.axes[0].get_lines()
    assert (star.get_xdata()[0], star.get_ydata()[0]) == (1.5, 1.5)


def test_an_axis_of_one_value_makes_no_plane(tmp_path):
    axes = {GAIN: [10.0], PRIOR: AXES[PRIOR]}
    figure = draw_sweep(rows_of(axes, lambda n: 1.0 + n), axes, "msrep")
    reads_well(figure, tmp_path)
    assert figure.axes[0].get_xlabel() == PRIOR
    reads_well(draw_sweep(rows_of({GAIN: [10.0]}, lambda n: 1.0 + n), {GAIN: [10.0]}, "msrep"), tmp_path)
    reads_well(draw_sweep(rows_of({"a": [-1.0, 0.0]}, lambda n: 1.0 + n), {"a": [-1.0, 0.0]}, "msrep"), tmp_path)


@pytest.mark.parametrize(
    ("after", "said"),
    [
        (np.linspace(0.1, 0.3, 40), "tuned: mean 0.2 %"),
        (np.array([0.2, np.nan, 0.3]), "tuned: mean 0.25 %"),
        (np.full(3, np.nan), "tuned: every scenario diverged"),
    ],
)
def test_tuning_is_drawn_as_two_distributions(after, said, tmp_path):
    figure = draw_tuning({"before": np.linspace(0.5, 2.0, 40), "tuned": after}, "msrep")
    reads_well(figure, tmp_path)
    assert figure.axes[0].get_xlabel() != draw_tuning({"a": after}, "msrep_settled").axes[0].get_xlabel()
    legend = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert legend == ["before: mean 1.25 %", said]


@pytest.mark.failure
def test_a_picture_that_cannot_be_written_is_named(tmp_path):
    figure = draw_recording(DEFLECTION, title="rec")
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"file/a\.png: cannot be written"):
        save(figure, tmp_path / "file" / "a.png")
