"""What one estimate says in words."""

from __future__ import annotations

import numpy as np
import pytest

from tuning.files.shipped import CONFIGS
from tuning.kinds.log.answer import _why_unknown
from tuning.study.loading import load_config


@pytest.mark.failure
@pytest.mark.parametrize(
    ("stiffness", "said"),
    [([0.0, 50.0], "is 20 % at best"), ([0.0, 0.0], "is unknown"), ([np.nan, 1.0], "is unknown")],
)
def test_a_stiffness_of_zero_has_no_relative_deviation(stiffness, said):
    config = load_config(CONFIGS / "tuned" / "sea_sensor.toml")
    columns = {
        "stiffness": np.array(stiffness),
        "stiffness_std": np.array([20.0, 10.0]),
        "deflection": np.array([0.0, 0.1]),
    }
    assert said in _why_unknown(columns, config, None)
