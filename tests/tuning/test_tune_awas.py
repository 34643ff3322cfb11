"""The tuning of the AwAS study as a user runs it, from starts all over the bounds, judged on unseen noise."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from tests.tuning.builders import SERIAL
from tuning.search.refine import Search, tune
from tuning.study.loading import load_study

STARTS = 5


def start_of(number: int) -> list[str]:
    """Return the settings that move the study's own numbers to a point of a Sobol sequence in the bounds."""
    bounds = load_study(SERIAL).tune.parameters
    shares = stats.qmc.Sobol(len(bounds), rng=np.random.default_rng(7)).random_base2(3)[number]
    places = zip(bounds.items(), 0.05 + 0.9 * shares, strict=True)
    return [f"{path}={float(b.low * (b.high / b.low) ** share)!r}" for (path, b), share in places]


@pytest.mark.slow(twin="tests/tuning/test_gradient.py::test_every_algorithm_leads_down_within_the_bounds")
@pytest.mark.statistical
@pytest.mark.parametrize("number", range(STARTS))
def test_tuning_reaches_a_quarter_of_a_percent_on_unseen_noise_from_any_start(number, tmp_path):
    study = load_study(SERIAL, start_of(number))
    assert study.scenarios.held_out >= 256
    tuned = tune(Search(study, "gradient"), tmp_path / "run", quiet=True)
    judged = tuned.held_out
    interval = f"[{judged.low:.4f}, {judged.high:.4f}]"
    print(f"start {number}: {judged.mean:.4f} % {interval}, before {tuned.before.mean:.4f} %")
    assert judged.scenarios >= 256
    assert judged.diverged == 0
    # The bound is the paper's project goal; its own numbers give 0.9 %, the true torque 0.18 %. The bootstrap's
    # 95 % interval must itself lie below halfway between, so that the mean of these draws is no lucky one.
    assert judged.mean <= 0.25
    assert 0.0 < judged.low < judged.mean < judged.high < 0.5
