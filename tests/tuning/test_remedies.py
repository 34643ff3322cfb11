"""What to do about failures: planted causes are found with their ranges, and what is promised holds elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tuning.builders import PRIOR, SERIAL, SMALL, TINY
from tuning.scoring.remedies import advise, find_remedy
from tuning.scoring.summary import summarise
from tuning.study.population import Population
from tuning.study.scores import SCORES

RNG = np.random.default_rng(11)
SIZE = 4000
COUNTS = "sensing.motor_position.encoder.counts_per_revolution"
INERTIA, GAIN = "joint.motor.inertia", "sensing.motor_torque.gain"


def drawn() -> dict[str, np.ndarray]:
    return {
        INERTIA: RNG.uniform(0.9e-5, 1.1e-5, SIZE),
        GAIN: RNG.normal(1.0, 0.01, SIZE),
        COUNTS: RNG.choice([4096.0, 16384.0, 65536.0], SIZE),
    }


@pytest.mark.statistical
def test_a_planted_tolerance_is_found_to_a_bin_and_holds_on_other_robots():
    numbers = drawn()
    failed = np.abs(numbers[INERTIA] - 1e-5) > 0.03e-5
    remedy = find_remedy("bad", failed, numbers, 0.05)
    (kept,) = remedy.kept
    assert kept.path == INERTIA
    # A twentieth of the range, 1 %, at either end: a bin is kept whole or left out.
    assert kept.low == pytest.approx(0.97e-5, abs=0.011e-5)
    assert kept.high == pytest.approx(1.03e-5, abs=0.011e-5)
    assert remedy.meets_target
    others = drawn()
    inside = (others[INERTIA] >= kept.low) & (others[INERTIA] <= kept.high)
    assert (np.abs(others[INERTIA][inside] - 1e-5) > 0.03e-5).mean() <= remedy.left[2] + 0.02


def test_two_causes_are_taken_one_after_another_the_heavier_first():
    numbers = drawn()
    failed = (numbers[COUNTS] == 4096.0) | (numbers[INERTIA] > 1.08e-5)
    first, second = find_remedy("bad", failed, numbers, 0.02).kept
    assert (first.path, first.levels) == (COUNTS, [16384.0, 65536.0])
    assert second.path == INERTIA
    assert second.high == pytest.approx(1.08e-5, abs=0.011e-5)


@pytest.mark.statistical
def test_failures_that_nothing_explains_get_no_cause_and_few_failures_no_remedy():
    numbers = drawn()
    remedy = find_remedy("bad", RNG.random(SIZE) < 0.5, numbers, 0.05)
    assert remedy.kept == []
    assert "no number that varies explains it" in advise(remedy, "msrep > 1 %", {})[1]
    assert find_remedy("bad", RNG.random(SIZE) < 0.01, numbers, 0.05) is None
    assert find_remedy("bad", np.ones(8, bool), {}, 0.05).kept == []


def test_halves_are_drawn_by_lot_for_sobol_points_alternate():
    # The first coordinate of Sobol points: even ones in the lower half, odd ones in the upper.
    numbers = {INERTIA: np.where(np.arange(SIZE) % 2 == 0, 0.25, 0.75) + RNG.uniform(-0.25, 0.25, SIZE)}
    remedy = find_remedy("bad", numbers[INERTIA] > 0.3, numbers, 0.05)
    assert remedy.robots > 0.2 * SIZE / 2
    assert remedy.meets_target


def test_the_advice_names_range_unit_belief_and_what_is_left():
    numbers = drawn()
    failed = np.abs(numbers[INERTIA] - 1e-5) > 0.03e-5
    own = {INERTIA: 1e-5, "estimator.torque.motor_inertia": 1e-5, "estimator.torque.motor_damping": 1e-5}
    head, keep, identify, left = advise(find_remedy("bad", failed, numbers, 0.05), "msrep > 1 %", own)
    assert head.startswith("bad (msrep > 1 %): ")
    assert head.endswith(" % fail, 5 % may")
    assert f"{INERTIA} matters most: keep it within 9." in keep
    assert "kg·m²" in keep
    assert "% of the study's 1e-05" in keep
    assert identify.endswith("identify it on each robot and set estimator.torque.motor_inertia to what was found")
    assert "robots not used to find it" in left
    counts = numbers[COUNTS] == 4096.0
    _, keep, choose, _ = advise(find_remedy("bad", counts, numbers, 0.05), "msrep > 1 %", own)
    assert "keep it at 16384 or 65536 counts (drawn: 4096 … 65536 counts)" in keep
    assert "choose a sensor that has it" in choose
    off = np.abs(numbers[GAIN] - 1.0) > 0.005
    assert "calibrate this sensor" in advise(find_remedy("bad", off, numbers, 0.05), "msrep > 1 %", own)[2]


def test_a_summary_says_what_to_do_or_that_there_is_nothing():
    numbers = drawn()
    vary = {path: {"type": "uniform", "low": 0.0, "high": 1.0} for path in numbers}
    population = Population.model_validate({"vary": vary, "failures": {"bad": "msrep > 1"}})
    rows = {"scenario": np.arange(SIZE), "status": np.zeros(SIZE, int)} | {m: np.ones(SIZE) for m in SCORES}
    rows |= numbers | {"msrep": np.where(numbers[COUNTS] == 4096.0, 2.0, 0.5)}
    said = summarise(rows, None, population, (), "msrep", 1)
    assert said.advice[0].startswith("bad (msrep > 1 %): ")
    assert said.remedies[0].kept[0].path == COUNTS
    content = summarise(rows, None, population, (), "msrep", 1, target=0.5)
    assert content.advice == ["nothing: of no failure more than 50 % of the robots have it"]


@pytest.mark.cli
def test_the_command_prints_units_never_and_what_to_do(vsajax, tmp_path):
    vary = "population.vary={'sensing.elastic_torque.gain'={type='choice', values=[1.0, 4.0]}}"
    failures = "population.failures={far='msrep > 150'}"
    words = [
        word
        for setting in (*SMALL, *TINY, f"{PRIOR}=1e8", "sensing.elastic_torque.gain=1.0", vary, failures)
        for word in ("--set", setting)
    ]
    said = vsajax("montecarlo", SERIAL, "-o", tmp_path / "run", "--scenarios", "128", *words).out
    assert "known_time [s]" in said
    assert "never" in said
    assert "inf" not in said.replace("influences", "")
    assert "nan" not in said
    assert "what to do:\n  far (msrep > 150 %): " in said
    assert "sensing.elastic_torque.gain matters most: keep it at 1 (drawn: 1 … 4)" in said
    allowed = vsajax(
        "montecarlo", SERIAL, "-o", tmp_path / "run", "--scenarios", "128", *words, "--target", "0.9", "--resume"
    )
    assert "nothing: of no failure more than 90 %" in allowed.out
