"""Answers as tables, data frames and pictures."""

from __future__ import annotations

import sys
from html.parser import HTMLParser
from types import ModuleType

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vsajax
from vsajax import showing
from vsajax.types import Signals

TIME = np.linspace(0.0, 1.0, 50)


def estimate(lanes: int = 0) -> vsajax.Estimate:
    """Return an estimate of a pair of transmissions whose first answers are not certain, in lanes if asked for."""
    series = jnp.asarray(np.linspace(1.0, 2.0, 50))
    std = jnp.where(series < 1.1, jnp.inf, 0.1)
    one = vsajax.Estimate(series, std, 2 * series, series > 1.5, Signals(*[series] * 5))
    pair = one._replace(sides=(one, one))
    return jax.tree.map(lambda x: jnp.stack([x] * lanes), pair) if lanes else pair


class Cells(HTMLParser):
    """The words of a table's cells."""

    def __init__(self, text: str):
        super().__init__()
        self.words: list[str] = []
        self.feed(text)

    def handle_data(self, data):
        self.words.append(data)


def test_the_columns_are_all_arrays_by_dotted_name():
    found = showing.columns(estimate())
    assert {"stiffness", "known", "signals.torque", "sides.1.signals.torque"} <= set(found)
    assert "held" not in found
    np.testing.assert_array_equal(found["sides.0.stiffness"], np.linspace(1.0, 2.0, 50))


def test_a_notebook_shows_shapes_and_ranges():
    cells = Cells(estimate()._repr_html_()).words
    assert cells[0] == "Estimate"
    at = cells.index("stiffness")
    assert cells[at : at + 6] == ["stiffness", "50", "1", "1.5", "2", "50 of 50"]
    at = cells.index("stiffness_std")
    assert cells[at + 5] == "45 of 50"
    assert "2×50" in Cells(estimate(lanes=2)._repr_html_()).words


@pytest.fixture
def pandas(monkeypatch) -> None:
    """Something that is called pandas and keeps what a data frame is made of."""
    module = ModuleType("pandas")
    module.DataFrame = dict  # pyright: ignore[reportAttributeAccessIssue]
    monkeypatch.setitem(sys.modules, "pandas", module)


@pytest.mark.usefixtures("pandas")
def test_a_frame_has_a_row_a_sample_and_of_scores_one():
    frame = estimate().to_pandas()
    assert {values.shape for values in frame.values()} == {(50,)}
    scores = vsajax.Scores(*map(jnp.asarray, np.arange(float(len(vsajax.Scores._fields)))))
    assert {values.shape for values in scores.to_pandas().values()} == {(1,)}
    many = jax.tree.map(lambda x: jnp.stack([x, x, x]), scores)
    assert many.to_pandas()["msrep"].tolist() == [1.0, 1.0, 1.0]
    recording = vsajax.Recording(jnp.asarray(TIME), deflection=jnp.asarray(TIME))
    assert list(recording.to_pandas()) == ["time", "deflection"]


def test_a_picture_has_a_panel_a_series_and_the_deviation_as_a_band():
    figure = estimate().plot(time=TIME)
    labels = [axis.get_ylabel() for axis in figure.axes]
    assert labels[:3] == ["stiffness", "elastic_torque", "known"]
    assert "stiffness_std" not in labels
    assert len(figure.axes[0].collections) == 1
    assert figure.axes[-1].get_xlabel() == "time [s]"
    recording = vsajax.Recording(jnp.asarray(TIME), deflection=jnp.asarray(TIME))
    (axis,) = recording.plot().axes
    np.testing.assert_array_equal(axis.lines[0].get_xdata(), TIME)
    assert estimate().plot().axes[-1].get_xlabel() == "sample"


@pytest.mark.failure
def test_what_cannot_be_shown_so_says_what_to_do(monkeypatch):
    with pytest.raises(ValueError, match=r"choose one lane first, jax.tree.map"):
        estimate(lanes=2).plot()
    with pytest.raises(ValueError, match="time has the shape"):
        estimate().plot(time=TIME[:-1])
    with pytest.raises(ValueError, match="no time axis"):
        showing.plot(vsajax.Scores(*[jnp.zeros(())] * len(vsajax.Scores._fields)))
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ModuleNotFoundError, match="pip install pandas"):
        estimate().to_pandas()
