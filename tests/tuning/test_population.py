"""What varies from robot to robot: every distribution, and draws that do not depend on how they are cut."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from tests.tuning.builders import small_serial
from tuning.files.errors import InputError
from tuning.problem.scenarios import draw_scenarios
from tuning.study.population import Population

SHARES = (np.arange(4000) + 0.5) / 4000
INERTIA, RATE = "joint.motor.inertia", "joint.spring.spring_rate"


def varied(**vary) -> Population:
    return Population.model_validate({"vary": vary})


@pytest.mark.oracle
@pytest.mark.parametrize(
    ("table", "law"),
    [
        ({"type": "normal", "mean": 2.0, "std": 0.5}, stats.norm(2.0, 0.5)),
        ({"type": "normal", "mean": 0.0, "std": 1.0, "low": -0.5, "high": 2.0}, stats.truncnorm(-0.5, 2.0)),
        ({"type": "lognormal", "median": 3.0, "sigma": 0.4}, stats.lognorm(0.4, scale=3.0)),
        ({"type": "uniform", "low": -1.0, "high": 3.0}, stats.uniform(-1.0, 4.0)),
        ({"type": "loguniform", "low": 0.1, "high": 10.0}, stats.loguniform(0.1, 10.0)),
        ({"type": "integer", "low": 12, "high": 16}, stats.randint(12, 17)),
    ],
    ids=lambda value: value["type"] if isinstance(value, dict) else "",
)
def test_draws_follow_their_distribution(table, law):
    drawn = varied(x=table).values(SHARES[:, None], {"x": 1.0})["x"]
    # Evenly spread shares: the empirical distribution is within a step of the law everywhere.
    at = np.unique(drawn)
    found = np.searchsorted(np.sort(drawn), at, side="right") / drawn.size
    np.testing.assert_allclose(found, law.cdf(at), atol=1.5 / SHARES.size)


def test_choices_come_as_often_as_their_weights_say():
    table = {"type": "choice", "values": [4096.0, 16384.0, 65536.0], "weights": [1.0, 2.0, 1.0]}
    drawn = varied(x=table).values(SHARES[:, None], {"x": 1.0})["x"]
    np.testing.assert_array_equal(np.unique(drawn, return_counts=True)[1], [1000, 2000, 1000])


def test_values_of_a_file_come_equally_often(tmp_path):
    path = tmp_path / "measured.csv"
    path.write_text("motor,inertia\n1,2.0e-5\n2,2.5e-5\n3,2.2e-5\n4,2.4e-5\n")
    drawn = varied(x={"type": "file", "path": str(path), "column": "inertia"}).values(SHARES[:, None], {"x": 1.0})[
        "x"
    ]
    values, counts = np.unique(drawn, return_counts=True)
    np.testing.assert_allclose(values, [2.0e-5, 2.2e-5, 2.4e-5, 2.5e-5])
    assert set(counts) == {1000}


def test_relative_draws_are_factors_of_the_own_number():
    tables = {kind: {"type": "uniform", "low": 0.9, "high": 1.1, "relative": kind == "b"} for kind in "ab"}
    drawn = varied(**tables).values(np.stack([SHARES, SHARES], axis=1), {"a": 5.0, "b": 5.0})
    np.testing.assert_allclose(drawn["b"], 5.0 * drawn["a"])


@pytest.mark.statistical
def test_correlated_numbers_have_their_means_deviations_and_correlation():
    group = {"paths": ["a", "b"], "mean": [1.0, 10.0], "std": [0.1, 2.0], "correlation": [[1.0, 0.7], [0.7, 1.0]]}
    population = Population.model_validate({"correlated": [group]})
    drawn = population.values(population.shares((0, 0), 0, 40000), {"a": 1.0, "b": 1.0})
    table = np.stack([drawn["a"], drawn["b"]])
    # Five standard errors of a mean, of a deviation, of a correlation over 40,000 draws.
    np.testing.assert_allclose(table.mean(axis=1), [1.0, 10.0], atol=5 * 2.0 / 200)
    np.testing.assert_allclose(table.std(axis=1), [0.1, 2.0], rtol=5 / 283)
    assert np.corrcoef(table)[0, 1] == pytest.approx(0.7, abs=5 * 0.51 / 200)
    assert list(population.factors) == ["a & b"]


@pytest.mark.equivalence
@pytest.mark.parametrize("sampling", ["random", "sobol"])
@pytest.mark.parametrize("size", [1, 4, 6])
def test_a_draw_does_not_depend_on_how_the_draws_are_cut(sampling, size):
    vary = {f"x{i}": {"type": "uniform", "low": 0.0, "high": 1.0} for i in range(size)}
    population = Population.model_validate({"sampling": sampling, "vary": vary})
    whole = population.shares((3, 1), 0, 100)
    pieces = [population.shares((3, 1), start, count) for start, count in ((0, 7), (7, 60), (67, 33))]
    np.testing.assert_array_equal(np.concatenate(pieces), whole)
    assert (population.shares((4, 1), 0, 100) != whole).all()
    assert whole.min() > 0.0
    assert whole.max() < 1.0


def test_scenarios_carry_the_numbers_and_streams_have_their_own():
    study = small_serial(f"population.vary={{'{INERTIA}'={{type='uniform', low=0.9, high=1.1, relative=true}}}}")
    train, held_out = (draw_scenarios(study, stream, 50).numbers[INERTIA] for stream in ("train", "held_out"))
    assert ((train > 0.9 * 2.3e-5) & (train < 1.1 * 2.3e-5)).all()
    assert not np.intersect1d(train, held_out).size
    np.testing.assert_array_equal(draw_scenarios(study, "train", 5, 20).numbers[INERTIA], train[20:25])


@pytest.mark.failure
@pytest.mark.parametrize(
    ("setting", "said"),
    [
        (
            "vary={'joint.motor.inertias'={type='uniform', low=0.9, high=1.1}}",
            ["joint.motor.inertias", "no number"],
        ),
        (f"vary={{'{INERTIA}'={{type='normal', mean=1.0, std=0.5, relative=true}}}}", ["reaches -", "cut it off"]),
        (f"vary={{'{INERTIA}'={{type='uniform', low=2.0, high=1.0}}}}", ["low must be below high"]),
        (f"vary={{'{INERTIA}'={{type='gaussian', mean=1.0}}}}", ["gaussian", "normal"]),
        (f"vary={{'{INERTIA}'={{type='file', path='gone.csv', column='x'}}}}", ["gone.csv", "no such file"]),
        ("failures={bad='msrep above 1'}", ["failures.bad", "msrep_settled > 1"]),
        ("failures={bad='mserp > 1'}", ["mserp", "metrics: mse"]),
        (
            f"correlated=[{{paths=['{INERTIA}', '{RATE}'], mean=[1.0, 1.0], std=[0.1, 0.1], "
            "correlation=[[1.0, 1.0], [1.0, 1.0]], relative=true}]",
            ["positive definite"],
        ),
    ],
)
def test_a_mistake_is_named_with_its_way_out(setting, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    key, _, value = setting.partition("=")
    with pytest.raises(InputError) as caught:
        small_serial(f"population.{key}={value}")
    for words in said:
        assert words in str(caught.value)


@pytest.mark.failure
def test_a_number_cannot_be_drawn_and_tuned():
    path = "estimator.fit.prior_scale"
    with pytest.raises(InputError, match=r"is in tune.parameters too"):
        small_serial(
            f"population.vary={{'{path}'={{type='loguniform', low=0.1, high=1.0}}}}",
            f"tune.parameters={{'{path}'={{low=0.1, high=1.0}}}}",
        )
