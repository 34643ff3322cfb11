"""Ranges of numbers, in a study and on the command line."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from tuning.files.errors import InputError
from tuning.study.ranges import Axis, Bounds, parse_axis

positive = st.floats(1e-12, 1e12)


@pytest.mark.parametrize(
    ("text", "path", "values"),
    [
        ("a.b=1,2,5", "a.b", [1.0, 2.0, 5.0]),
        ("a.b=3", "a.b", [3.0]),
        (" a.b = 2 , 1e-3 ", "a.b", [2.0, 1e-3]),
        ("a.b=-1,1", "a.b", [-1.0, 1.0]),
        ("a.b=lin(0,1,5)", "a.b", [0.0, 0.25, 0.5, 0.75, 1.0]),
        ("a.b=linear(-1, 1, 3)", "a.b", [-1.0, 0.0, 1.0]),
        ("a.b=log(1e-2,1e2,5)", "a.b", [0.01, 0.1, 1.0, 10.0, 100.0]),
        ("a.b= log( 10 , 10 , 1 )", "a.b", [10.0]),
    ],
)
def test_an_axis_on_the_command_line(text, path, values):
    found, axis = parse_axis(text)
    assert found == path
    # geomspace goes through logarithms: a few rounding errors of 2⁻⁵³ times ln 100.
    np.testing.assert_allclose(axis.grid(), values, rtol=1e-14)
    assert axis.ends() == (min(axis.grid()), max(axis.grid()))


@pytest.mark.failure
@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("a.b", "is not of the form a.b=values"),
        ("=1,2", "is not of the form a.b=values"),
        ("a.b=", "could not convert string to float"),
        ("a.b=1,,2", "could not convert string to float"),
        ("a.b=1,1", "each only once"),
        ("a.b=1,nan", "finite number"),
        ("a.b=inf", "finite number"),
        ("a.b=log(1,2)", "could not convert"),
        ("a.b=log(1,2,3,4)", "could not convert"),
        ("a.b=log(1,2,2.5)", "invalid literal for int()"),
        ("a.b=log(1,2,0)", "greater than or equal to 1"),
        ("a.b=log(2,1,3)", "low must be below high; got 2.0 and 1.0"),
        ("a.b=log(0,1,3)", "a log range must be positive; got low = 0.0 (or use scale = 'linear')"),
        ("a.b=lin(1,1,3)", "low must be below high"),
    ],
)
def test_an_axis_that_cannot_be_read_is_named_with_an_example(text, problem):
    with pytest.raises(InputError) as caught:
        parse_axis(text)
    (mistake,) = caught.value.mistakes
    assert mistake.place == f"--grid {text}"
    assert problem in mistake.problem
    assert "e.g. --grid estimator.torque.observer_gain=log(10,1000,8)" in mistake.fix


@pytest.mark.failure
@pytest.mark.parametrize(
    ("table", "problem"),
    [
        ({"low": 1.0, "high": 1.0}, "low must be below high; got 1.0 and 1.0"),
        ({"low": 2.0, "high": 1.0}, "low must be below high; got 2.0 and 1.0"),
        ({"low": 0.0, "high": 1.0}, "a log range must be positive; got low = 0.0"),
        ({"low": 1.0, "high": 2.0, "points": 1}, "greater than or equal to 2"),
        ({"low": 1.0}, "Field required"),
        ({"low": 1.0, "high": 2.0, "step": 0.1}, "Extra inputs"),
    ],
)
def test_bounds_that_enclose_nothing_are_refused(table, problem):
    with pytest.raises(ValidationError, match=problem):
        Bounds.model_validate(table)


@pytest.mark.failure
@pytest.mark.parametrize(
    "table",
    [
        {},
        {"low": 1.0, "high": 2.0},
        {"low": 1.0, "points": 3},
        {"values": [1.0], "low": 1.0, "high": 2.0, "points": 3},
    ],
)
def test_an_axis_is_either_a_list_or_a_range(table):
    with pytest.raises(ValidationError, match="either a list of values, or low, high and points"):
        Axis.model_validate(table)


@given(
    low=positive, ratio=st.floats(1.001, 1e6), points=st.integers(2, 50), scale=st.sampled_from(["log", "linear"])
)
def test_a_range_starts_and_ends_where_it_says_and_is_even_on_its_scale(low, ratio, points, scale):
    for kind in (Bounds, Axis):
        span = kind.model_validate({"low": low, "high": low * ratio, "points": points, "scale": scale})
        values = np.array(span.grid())
        assert len(values) == points
        assert (values[0], values[-1]) == span.ends() == (low, low * ratio)
        steps = np.diff(np.log(values) if scale == "log" else values)
        # Steps are differences of numbers up to |ln| ≈ 28 or low·ratio, each rounded.
        size = max(abs(np.log(values)).max(), 1.0) if scale == "log" else low * ratio
        np.testing.assert_allclose(steps, steps.mean(), rtol=0.0, atol=8 * np.finfo(float).eps * size)


def test_a_list_in_a_study_is_an_axis():
    assert Axis.model_validate([3.0, 1.0]).grid() == [3.0, 1.0]
    assert Axis.model_validate([3.0, 1.0]).ends() == (1.0, 3.0)
