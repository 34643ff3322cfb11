"""The factor on the band: fitted on training scenarios, it holds on others, and is written with what was tuned."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.tuning.builders import PRIOR, SERIAL, SMALL
from tuning.kinds.estimation.calibration import calibrate, known_errors
from tuning.study.loading import load_config, load_study, with_numbers
from tuning.study.paths import numeric_paths

BAND = "estimator.fit.band"
LONGER = (*SMALL, "clock.duration=1.0", "scorer.warm_up=0.3")


@pytest.fixture(scope="module")
def study():
    return load_study(SERIAL, [*LONGER, "scenarios.train=8", "scenarios.held_out=8"])


@pytest.mark.statistical
def test_the_factor_makes_the_band_hold_as_much_as_it_says_on_the_scenarios_that_it_is_fitted_on(study):
    factors = calibrate(study)
    assert factors.keys() == {BAND}
    again = with_numbers(study, factors, "calibrated")
    inside = float(np.mean(known_errors(again) <= study.scorer.sigmas))
    # A wider band may lose the widest of the known samples, a narrower one may win some.
    assert abs(inside - 0.95) < 0.01
    assert calibrate(again)[BAND] == pytest.approx(factors[BAND], rel=0.05)


@pytest.mark.statistical
def test_a_band_that_was_made_too_narrow_is_widened_by_as_much(study):
    own = calibrate(study)[BAND]
    narrow = with_numbers(study, {BAND: 0.1}, "narrow")
    assert calibrate(narrow)[BAND] == pytest.approx(own, rel=0.05)


@pytest.mark.failure
def test_what_is_never_known_has_no_factor(study):
    strict = with_numbers(study, {"estimator.gate.max_relative_std": 1e-12}, "strict")
    assert calibrate(strict) == {}


@pytest.mark.cli
def test_what_is_tuned_is_written_with_its_factor_and_judged_with_it(vsajax, tmp_path):
    search = f"tune={{starts=1, screen=1, max_steps=1, parameters={{'{PRIOR}'={{low=0.5,high=2.0}}}}}}"
    sets = [
        word for one in (*LONGER, "scenarios.train=4", "scenarios.held_out=4", search) for word in ("--set", one)
    ]
    ended = vsajax("tune", SERIAL, "-o", tmp_path / "run", *sets)
    assert ended.code == 0
    lines = [line for line in ended.out.splitlines() if "held out:" in line]
    assert all("inside the band" in line for line in lines)
    told = json.loads(vsajax("tune", SERIAL, "-o", tmp_path / "run", *sets, "--resume", "--json").out)
    best = load_config(tmp_path / "run" / "best.toml")
    assert numeric_paths(best)[BAND] == told["calibration"][BAND] != 1.0
    assert 0.0 <= told["held_out"]["coverage"] <= 1.0
    # The factor is no number of the search, and no change to what it has found.
    reported = vsajax("report", tmp_path / "run", "-o", tmp_path / "page.html")
    assert (reported.code, reported.err) == (0, "")
