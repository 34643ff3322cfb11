"""Configurations side by side: a difference that rounding makes is none, one that may be 0 is a tie."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.tuning.builders import PRIOR, SERIAL, SMALL, TINY
from tuning.scoring.comparison import Contender
from tuning.scoring.intervals import equal_to_rounding, judge, paired_interval
from tuning.study.base import Tune
from tuning.study.statistic import Statistic

RNG = np.random.default_rng(5)
MEAN = Statistic()
WORDS = [word for setting in (*SMALL, *TINY) for word in ("--set", setting)]


def contender(first: np.ndarray, own: np.ndarray) -> Contender:
    scores = {"msrep": own, "msrep_settled": own, "convergence_time": own, "diverged": np.zeros(own.size)}
    equal = equal_to_rounding(first, own)
    shares = (float(np.mean((own < first) & ~equal)), float(np.mean(equal)))
    return Contender("own", judge(scores, Tune(), seed=0), *paired_interval(first, own, MEAN, seed=0), *shares)


def test_what_only_rounding_tells_apart_is_equal():
    first = RNG.lognormal(size=64)
    found = contender(first, first * (1.0 + RNG.choice([-5e-17, 0.0, 4e-16, 1e-12], 64)))
    assert (found.verdict, found.wins, found.ties) == ("equal", 0.0, 1.0)
    assert (found.difference, found.low, found.high) == (0.0, 0.0, 0.0)


@pytest.mark.statistical
def test_a_difference_whose_interval_holds_none_is_a_tie_and_another_is_not():
    first = RNG.lognormal(size=64)
    assert contender(first, first * RNG.permutation(np.linspace(0.8, 1.2, 64))).verdict == "tie"
    assert contender(first, 0.9 * first).verdict == "better"
    assert contender(first, 1.1 * first).verdict == "worse"
    shifted = contender(first, first + 0.5)
    assert shifted.verdict == "worse"
    assert [shifted.low, shifted.high] == pytest.approx([0.5, 0.5], abs=1e-12)


@pytest.mark.cli
def test_a_configuration_against_itself_is_equal_in_words(vsajax, tmp_path):
    for name in ("one", "two"):
        (tmp_path / f"{name}.toml").write_text(SERIAL.read_text())
    words = ["compare", tmp_path / "one.toml", tmp_path / "two.toml", "-s", SERIAL, *WORDS]
    ended = vsajax(*words, "-o", tmp_path / "run")
    assert ended.code == 0
    assert "equal to rounding in all of 5" in ended.out
    assert "no difference is shown from the first: " in ended.out
    again = vsajax(*words, "-o", tmp_path / "run", "--resume", "--json")
    assert [row["verdict"] for row in json.loads(again.out)["configs"]] == ["first", "equal"]


@pytest.mark.cli
def test_a_grid_search_prints_its_numbers(vsajax, tmp_path):
    parameters = f"tune.parameters={{'{PRIOR}'={{low=1e-3,high=10.0,points=3}}}}"
    words = ["tune", SERIAL, "-o", tmp_path / "run", "--method", "grid", *WORDS, "--set", parameters]
    said = vsajax(*words).out
    assert "the best of 3 points:" in said
    best, *_ = [line.split() for line in said.splitlines() if line.startswith("1 ")]
    points = json.loads(vsajax(*words, "--resume", "--json").out)["points"]
    assert len(points) == 3
    assert points == sorted(points, key=lambda point: point["objective"])
    assert [float(x) for x in best[1:]] == pytest.approx([points[0][PRIOR], points[0]["objective"]], rel=1e-5)


@pytest.mark.failure
@pytest.mark.cli
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            "tune S -o run --trials 8",
            "--trials does not go with --method gradient: it is of tpe, cmaes and pareto",
        ),
        ("tune S -o run --method grid --batch 8", "--batch does not go with --method grid"),
        ("tune S -o run --method grid --starts 2", "--starts does not go with --method grid"),
        ("tune S -o run --method hybrid --budget 2", "--budget does not go with --method hybrid"),
        ("tune S -o run --method tpe --starts 2", "--starts does not go with --method tpe: it is of gradient and"),
        ("tune S -o run --method cmaes --budget 2", "--budget does not go with --method cmaes"),
        ("tune S -o run --method pareto --algorithm bfgs", "--algorithm does not go with --method pareto"),
        ("sweep S -o run --dry-run --resume", "--resume does not go with --dry-run"),
        ("montecarlo S -o run --dry-run --precision 0.1", "--precision does not go with --dry-run"),
        ("export S --to json -o out --recording r.csv --duration 1", "--duration does not go with --recording"),
        ("export out --check --duration 1", "--duration does not go with the check of an exported folder"),
        ("compare S S -s S -o run", "is named twice"),
        ("init serial a.toml -o b.toml", "name the file once"),
    ],
)
def test_an_option_that_nothing_would_come_of_is_refused(words, said, vsajax, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ended = vsajax(*(str(SERIAL) if word == "S" else word for word in words.split()))
    assert (ended.code, ended.out) == (2, "")
    assert said in ended.err
    assert list(tmp_path.iterdir()) == []
