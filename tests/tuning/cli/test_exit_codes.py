"""How endings that are nobody's mistake become exit codes."""

from __future__ import annotations

import json

import pytest

from tests.tuning.builders import SERIAL
from tuning import papers
from tuning.exports import export as exporting
from tuning.exports.recheck import Exported
from tuning.papers import Report, Row
from tuning.problem import replay


def raising(error: BaseException):
    def fail(*_args, **_options):
        raise error

    return fail


@pytest.mark.cli
def test_a_reproduction_out_of_tolerance_ends_with_1_and_says_which_row(vsajax, monkeypatch):
    rows = [Row("good", 1.0, 1.01, "%", 0.9, 1.1), Row("bad", None, 3.0, "rad", 0.0, 1.0, note="corrected")]
    monkeypatch.setattr(papers, "reproduce_paper", lambda *_: [Report("A paper", rows, [])])
    ended = vsajax("reproduce", "serial", "--json")
    assert ended.code == 1
    result = json.loads(ended.out)
    assert result["ok"] is False
    assert [(row["name"], row["printed"], row["ok"]) for row in result["rows"]] == [
        ("good", 1.0, True),
        ("bad", None, False),
    ]
    ended = vsajax("reproduce", "serial")
    assert ended.code == 1
    for words in ("A paper", "0.9 … 1.1", "NOT MET", "bad: corrected"):
        assert words in ended.out
    monkeypatch.setattr(papers, "reproduce_paper", lambda *_: [Report("A paper", rows[:1], [])])
    assert vsajax("reproduce", "serial", "--quiet") == (0, "", "")


@pytest.mark.cli
def test_an_export_that_does_not_hold_ends_with_1(vsajax, monkeypatch, tmp_path):
    result = {"name": "read back", "state": "failed", "what": "what was read back DIFFERS", "figures": {}}
    broken = Exported([tmp_path / "estimator.toml"], [result])
    monkeypatch.setattr(exporting, "export_config", lambda *_, **__: broken)
    ended = vsajax("export", SERIAL, "--to", "toml", "-o", tmp_path)
    assert ended.code == 1
    assert "failed   read back: what was read back DIFFERS" in ended.out
    assert json.loads(vsajax("export", SERIAL, "--to", "toml", "-o", tmp_path, "--json").out)["ok"] is False


@pytest.mark.cli
def test_an_interruption_ends_with_3_and_says_how_to_go_on(vsajax, monkeypatch, tmp_path):
    monkeypatch.setattr(replay, "simulate", raising(KeyboardInterrupt()))
    ended = vsajax("simulate", SERIAL, "-o", tmp_path / "r.csv")
    assert (ended.code, ended.out) == (3, "")
    assert "interrupted" in ended.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.cli
def test_a_joint_that_diverges_is_the_users_to_mend_and_a_defect_is_not(vsajax, monkeypatch, tmp_path):
    monkeypatch.setattr(replay, "simulate", raising(FloatingPointError("the simulated joint diverges")))
    ended = vsajax("simulate", SERIAL, "-o", tmp_path / "r.csv")
    assert (ended.code, ended.out) == (2, "")
    assert "error: the simulated joint diverges" in ended.err
    monkeypatch.setattr(replay, "simulate", raising(RuntimeError("a defect of ours")))
    with pytest.raises(RuntimeError, match="a defect of ours"):
        vsajax("simulate", SERIAL, "-o", tmp_path / "r.csv")
