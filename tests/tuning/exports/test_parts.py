"""Numbers, units, ranges and layouts as they are written into artefacts."""

from __future__ import annotations

import math

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from tests.tuning.builders import ANTAGONISTIC, SERIAL
from tuning.exports.c99.printing import decimal
from tuning.exports.checks.checking import deviation
from tuning.exports.layout import told
from tuning.exports.ranges import Range, range_of
from tuning.exports.units import base_units
from tuning.study.loading import load_config
from vsajax.estimators import ResidualTorque


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_number_is_a_number_to_every_reader_and_to_the_last_bit(value):
    text = decimal(value)
    assert "." in text
    assert float(text) == value
    read = yaml.safe_load(text)
    assert isinstance(read, float)
    assert read == value


def test_numbers_are_written_as_ros_wants_them():
    assert [decimal(x) for x in (1e-3, 1e20, 5e-324, -2.0, 0.1, 1e16)] == [
        "0.001",
        "1.0e+20",
        "5.0e-324",
        "-2.0",
        "0.1",
        "1.0e+16",
    ]


@pytest.mark.parametrize(
    ("unit", "exponents"),
    [
        ("N·m·s/rad", {"kg": 1, "m": 2, "s": -1, "rad": -1}),
        ("rad²/s⁴", {"rad": 2, "s": -4}),
        ("1/s", {"s": -1}),
        ("kg·m²", {"kg": 1, "m": 2}),
        ("N·m/rad", {"kg": 1, "m": 2, "s": -2, "rad": -1}),
        ("N·m/rad^(2i+1)", None),
        ("furlong", None),
    ],
)
def test_units_are_exponents_of_base_units(unit, exponents):
    assert base_units(unit) == exponents


def test_meaning_and_unit_come_from_the_docstring():
    assert told(ResidualTorque)["motor_inertia"] == ("B, as the estimator believes it", "kg·m²")


def test_ranges_are_those_of_the_study_file():
    serial = {(): load_config(SERIAL).estimator}
    assert range_of(serial, ("torque", "observer_gain")) == Range(0.0, None, True, False)
    assert range_of(serial, ("torque", "gear_ratio")) == Range(1.0, None, False, False)
    window = range_of({(): load_config(ANTAGONISTIC).estimator}, ("side", "window"))
    assert window == Range(0.004, 2.0)


def test_a_deviation_is_relative_to_the_value_or_the_typical_one():
    assert deviation([1.0, 2.0, 3.0], [1.0, 2.0, 3.0]) == 0.0
    assert deviation([1.0, 2.0, 3.3], [1.0, 2.0, 3.0]) == pytest.approx(0.1)
    assert deviation([1e-6, 2.0, 2.0], [0.0, 2.0, 2.0]) == pytest.approx(5e-7)
    assert deviation([math.inf, math.nan], [math.inf, math.nan]) == 0.0
    assert deviation([1.0], [math.nan]) == deviation([math.inf], [-math.inf]) == deviation([], [1.0]) == math.inf
