"""What is said of a population: honest intervals, planted influences, failures, lost scenarios."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy import stats

from tests.tuning.builders import small_serial
from tuning.problem.interface import Status
from tuning.scoring.summary import has_failed, probability, quantile, sobol_influences, summarise, write_summary
from tuning.study.population import Population
from tuning.study.scores import SCORES

RNG = np.random.default_rng(1)
FACTORS = ("x1", "x2", "x3", "noise draw")


def rows(count: int, **columns) -> dict[str, np.ndarray]:
    """Return rows that are all scored, with every metric 1 where nothing else is said."""
    return (
        {"scenario": np.arange(count), "status": np.zeros(count, int)}
        | {metric: np.ones(count) for metric in SCORES}
        | columns
    )


def ishigami(x: np.ndarray) -> np.ndarray:
    """sin x₁ + 7 sin² x₂ + 0.1 x₃⁴ sin x₁ on [−π, π]³, whose Sobol indices are known in closed form."""
    return np.sin(x[0]) + 7.0 * np.sin(x[1]) ** 2 + 0.1 * x[2] ** 4 * np.sin(x[0])


@pytest.mark.analytic
def test_planted_influences_are_found():
    count = 4096
    both = 2 * np.pi * stats.qmc.Sobol(6, rng=np.random.default_rng(0)).random(count).T - np.pi
    a, b = both[:3], both[3:]
    designs = [a, b]
    for i in range(3):
        mixed = a.copy()
        mixed[i] = b[i]
        designs.append(mixed)
    # The noise draw changes nothing here.
    designs.append(a)
    values = 10.0 ** np.concatenate([ishigami(x) for x in designs])
    influences, lost = sobol_influences(rows(values.size, msrep=values), FACTORS, "msrep")
    assert lost == 0
    for name, first, total in zip(FACTORS, (0.3139, 0.4424, 0.0, 0.0), (0.5576, 0.4424, 0.2437, 0.0), strict=True):
        found = influences[name]
        assert found.first.value == pytest.approx(first, abs=0.05)
        assert found.total.value == pytest.approx(total, abs=0.05)
        assert found.first.low - 1e-9 <= found.first.value <= found.first.high + 1e-9


@pytest.mark.oracle
def test_probability_has_the_clopper_pearson_interval():
    found = probability(np.arange(50) < 3)
    assert found.value == pytest.approx(0.06)
    assert found.low == pytest.approx(stats.beta.ppf(0.025, 3, 48))
    assert found.high == pytest.approx(stats.beta.ppf(0.975, 4, 47))
    assert probability(np.zeros(10, bool)).low == 0.0


@pytest.mark.statistical
@pytest.mark.parametrize("level", [0.5, 0.95])
def test_quantile_intervals_cover_whatever_the_distribution(level):
    studies, count = 2000, 200
    truth = stats.lognorm(1.5).ppf(level)
    draws = stats.lognorm(1.5).rvs((studies, count), random_state=RNG)
    hits = sum(found.low <= truth <= found.high for found in (quantile(row, level) for row in draws))
    # 95 % at least, by construction; four standard errors of 0.0049 below it, and not much above.
    assert 0.93 <= hits / studies <= 0.99


def test_a_scenario_without_a_score_fails_and_ranks_worst_but_has_no_part_in_quantiles():
    status = np.array([Status.OK, Status.ESTIMATE_DIVERGED, Status.OK, Status.MOTION_DIVERGED])
    columns = rows(4, msrep_settled=np.array([0.5, 1e9, 2.0, np.nan])) | {"status": status}
    population = Population.model_validate({"failures": {"bad": "msrep_settled > 1"}})
    np.testing.assert_array_equal(has_failed(columns, "bad", "msrep_settled > 1"), [False, True, True, True])
    summary = summarise(columns, None, population, FACTORS, "msrep_settled", 3)
    assert summary.failures["bad"].value == pytest.approx(0.75)
    assert summary.quantiles["msrep_settled"][0.99].value == 2.0
    assert summary.worst == [1, 3, 2]
    assert summary.status["scored"] == 2
    assert sum(summary.status.values()) == 4
    assert any("an estimate is not finite" in sentence for sentence in summary.sentences)


@pytest.mark.oracle
def test_a_rank_correlation_is_scipys_with_the_truth_in_its_interval():
    rng = np.random.default_rng(5)
    population = Population.model_validate({"vary": {"a": {"type": "normal", "mean": 0.0, "std": 1.0}}})
    truth, hits = 6.0 / np.pi * np.arcsin(-0.5 / np.sqrt(2.0)), 0
    for _ in range(12):
        number = rng.normal(size=60)
        columns = rows(60, msrep=np.exp(-number + rng.normal(size=60)), a=number)
        found = summarise(columns, None, population, FACTORS, "msrep", 0).correlations["a"]
        assert found.value == pytest.approx(stats.spearmanr(columns["msrep"], number).statistic)
        hits += found.low <= truth <= found.high
    # Of twelve intervals at 95 %, fewer than nine hold the truth once in 5000 times.
    assert hits >= 9


@pytest.mark.statistical
@pytest.mark.slow(twin="test_a_rank_correlation_is_scipys_with_the_truth_in_its_interval")
def test_rank_correlations_have_sign_and_honest_intervals():
    vary = {"a": {"type": "normal", "mean": 0.0, "std": 1.0}}
    population = Population.model_validate({"vary": vary})
    # Spearman's for a Pearson correlation of −1/√2.
    truth, hits, studies = 6.0 / np.pi * np.arcsin(-0.5 / np.sqrt(2.0)), 0, 200
    for _ in range(studies):
        number = RNG.normal(size=60)
        columns = rows(60, msrep=np.exp(-number + RNG.normal(size=60)), a=number)
        found = summarise(columns, None, population, FACTORS, "msrep", 0).correlations["a"]
        hits += found.low <= truth <= found.high
        assert found.value < 0.0
    # Three standard errors of 0.0154 about 95 %.
    assert 0.90 <= hits / studies <= 0.995


def test_a_summary_with_infinite_numbers_is_json(tmp_path):
    summary = summarise(rows(10, known_time=np.full(10, np.inf)), None, Population(), FACTORS, "msrep", 2)
    write_summary(summary, tmp_path / "summary.json")
    kept = json.loads((tmp_path / "summary.json").read_text())
    assert kept["quantiles"]["known_time"]["0.5"]["value"] == "Infinity"
    assert kept["scenarios"] == 10


def test_few_scenarios_leave_no_nan_in_what_is_said():
    summary = summarise(rows(8, msrep=np.arange(1.0, 9.0)), None, Population(), FACTORS, "msrep", 2)
    assert "–]" in summary.sentences[0]
    assert not [sentence for sentence in summary.sentences if "nan" in sentence]


def test_a_study_keeps_its_failures():
    study = small_serial("population.failures={late='known_time > 0.1'}")
    assert study.population.failures == {"late": "known_time > 0.1"}


@pytest.mark.oracle
@pytest.mark.parametrize("factors", [1, 2, 5])
def test_influences_are_scipys_and_repeat_to_the_bit_even_of_one_factor(factors):
    names = [f"x{i}" for i in range(factors)]
    values = np.random.default_rng(factors).lognormal(size=(factors + 2, 1, 64))
    columns = rows(values.size, msrep=values.reshape(-1))
    found, lost = sobol_influences(columns, names, "msrep", seed=7)
    assert (found, lost) == sobol_influences(columns, names, "msrep", seed=7)
    assert found != sobol_influences(columns, names, "msrep", seed=8)[0]
    if factors > 1:
        a, b, *mixed = np.log10(values)
        scipys = stats.sobol_indices(func={"f_A": a, "f_B": b, "f_AB": np.stack(mixed)}, n=64)
        np.testing.assert_allclose([one.first.value for one in found.values()], scipys.first_order, rtol=1e-10)
        np.testing.assert_allclose([one.total.value for one in found.values()], scipys.total_order, rtol=1e-10)
