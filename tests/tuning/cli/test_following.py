"""Every command ends with the command to type next, which works as it is printed."""

from __future__ import annotations

import inspect
import json
import math
import shlex
from pathlib import Path

import pytest

from tests.tuning.builders import PRIOR, tiny_tuning
from tuning.cli.following import improve
from tuning.cli.main import cli
from tuning.files.shipped import shipped_files
from tuning.papers import Report, Row
from tuning.scoring.sweep import GridSweep, write_winner
from tuning.study.base import resolved, to_toml
from tuning.study.loading import load_study
from tuning.terminal.following import fresh, sentence, words
from tuning.terminal.options import emit

HEBI = Path(__file__).parents[2] / "golden" / "hebi" / "exampleLog.csv"


def following(ended) -> list[str]:
    """Return the words of the line that a command ended with; its files are there, its folders are not."""
    assert (ended.code, ended.err) == (0, "")
    line = ended.out.splitlines()[-1].removeprefix("# ")
    assert line.startswith("Next: vsajax "), line
    assert sum("Next: vsajax" in text for text in ended.out.splitlines()) == 1
    name, *rest = shlex.split(line)[2:]
    command = cli.commands[name]
    # Below its group, as it runs: a command keeps the names of the help option that it was first made with.
    given = command.make_context(name, list(rest), parent=cli.make_context("vsajax", [name])).params
    for parameter in command.params:
        value = given.get(parameter.name or "")
        if not isinstance(value, Path) or str(value).startswith("shipped:"):
            continue
        reads = "-o" not in parameter.opts and parameter.name not in {"page", "file"}
        if reads or (name, parameter.name) == ("report", "run"):
            assert value.exists(), value
        elif name not in {"report", "estimate"}:
            assert not value.exists(), value
    return [name, *rest]


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    """An empty folder to work in, whose name a shell must see quoted, with a study that compiles in seconds."""
    folder = tmp_path / "a robot's runs"
    folder.mkdir()
    monkeypatch.chdir(folder)
    (folder / "my study.toml").write_text(to_toml(resolved(tiny_tuning())))
    return folder


@pytest.mark.contract
def test_no_answer_can_be_printed_without_the_command_that_follows():
    assert inspect.signature(emit).parameters["following"].default is inspect.Parameter.empty


@pytest.mark.cli
@pytest.mark.parametrize("name", shipped_files())
def test_after_check_comes_what_a_file_is_good_for(name, vsajax, here):
    ended = vsajax("check", f"shipped:{name}")
    first = following(ended)
    assert first[0] in {"simulate", "export", "tune", "stiffness", "init"}
    if first[0] == "init":
        assert following(vsajax(*first))[0] == "check"


@pytest.mark.cli
def test_from_a_new_study_each_line_leads_to_the_next(vsajax, here):
    assert following(vsajax("init", "--list")) == ["init", "serial", "study.toml"]
    # Where a name is taken, another is proposed.
    (here / "study.toml").touch()
    assert following(vsajax("doctor")) == ["init", "serial", "study-2.toml"]
    typed = ["check", "my study.toml", "--set", "seed=1"]
    names = []
    for _ in range(5):
        ended = vsajax(*typed)
        names.append(typed[0])
        typed = following(ended)
    assert names == ["check", "simulate", "estimate", "estimate", "check"]
    assert (here / "estimate.html").is_file()


@pytest.mark.cli
def test_a_map_that_was_proposed_is_checked_and_a_study_for_it_written(vsajax, here):
    (here / "log.csv").write_bytes(HEBI.read_bytes())
    ended = vsajax("init", "map", "log.csv", "-o", "map.toml")
    if "MISSING" not in ended.out:
        typed = following(ended)
        assert typed == ["check", "map.toml"]
        assert following(vsajax(*typed))[:2] == ["init", "sea"]


@pytest.mark.cli
def test_a_sweep_leaves_its_winner_to_the_last_bit_for_what_follows(vsajax, here):
    grid = ("--grid", f"{PRIOR}=log(0.1,10,4)", "--scenarios", "2")
    forecast = vsajax("sweep", "my study.toml", "-o", "runs/s", *grid, "--dry-run")
    typed = following(forecast)
    assert typed == ["sweep", "my study.toml", "-o", "runs/s", *grid]
    ended = vsajax(*typed)
    best = here / "runs" / "s" / "best.toml"
    assert "wrote runs/s/best.toml, " in ended.out
    assert following(ended) == ["tune", "runs/s/best.toml", "-o", "runs/tune"]
    found = json.loads(vsajax("sweep", "my study.toml", "-o", "runs/s", *grid, "--resume", "--json").out)
    assert found["winner"] == "runs/s/best.toml"
    winner, first = load_study(best), found["best"][0]
    assert resolved(winner)["estimator"]["fit"]["prior_scale"] == first[PRIOR]
    assert winner.provenance["command"] == "sweep"
    assert winner.provenance["train"]["mean"] == first["mean"]
    # What takes a configuration takes it: a recording is made from it, and it is exported.
    simulated = vsajax("simulate", best, "-o", "r.csv")
    assert following(simulated)[:4] == ["estimate", "r.csv", "-c", str(best)]


@pytest.mark.failure
def test_where_nothing_has_a_score_a_sweep_leaves_no_winner(tmp_path):
    planned = GridSweep(tiny_tuning(), {PRIOR: [1.0, 2.0]}, 2)
    assert write_winner(planned, {"configuration": 0, "mean": math.nan}, tmp_path / "best.toml") is None
    assert not (tmp_path / "best.toml").exists()


@pytest.mark.cli
@pytest.mark.parametrize("paper", ["serial", "antagonistic", "damping", "cartesian", "duel", "all"])
def test_after_a_paper_comes_a_study_of_its_joint(paper, vsajax, here, monkeypatch):
    from tuning import papers

    held = Report("A paper", [Row("good", 1.0, 1.01, "%", 0.9, 1.1)], [])
    monkeypatch.setattr(papers, "reproduce_paper", lambda *_: [held])
    typed = following(vsajax("reproduce", paper))
    assert following(vsajax(*typed)) == ["check", typed[2]]


@pytest.mark.cli
def test_machines_and_the_quiet_are_told_no_next_command(vsajax, here):
    for command in (("check", "my study.toml"), ("doctor",), ("init", "--list")):
        assert "Next" not in vsajax(*command, "--json").out
        json.loads(vsajax(*command, "--json").out)
        assert vsajax(*command, "--quiet") == (0, "", "")


@pytest.mark.cli
def test_paths_are_quoted_for_the_shell(tmp_path):
    odd = tmp_path / "it's; a $(robot).toml"
    line = sentence(words("check", odd, settings=["name='a b'"]))
    assert shlex.split(line) == ["Next:", "vsajax", "check", str(odd), "--set", "name='a b'"]
    assert fresh(odd) == odd
    odd.touch()
    assert fresh(odd).name == "it's; a $(robot)-2.toml"


@pytest.mark.slow(
    twin=(
        "test_from_a_new_study_each_line_leads_to_the_next",
        "test_a_sweep_leaves_its_winner_to_the_last_bit_for_what_follows",
    )
)
@pytest.mark.cli
def test_every_other_command_leads_on_too(vsajax, here):
    study = "my study.toml"
    one = (
        "--set",
        f"population={{ vary = {{ '{PRIOR}' = {{ type = 'uniform', low = 0.5, high = 2.0 }} }} }}",
    )
    tuned = vsajax("tune", study, "-o", "runs/t", "--starts", "1", "--budget", "2")
    assert following(tuned) == ["export", "runs/t/best.toml", "--to", "c99", "-o", "deploy", "--check"]
    assert following(vsajax("report", "runs/t"))[:2] == ["export", "runs/t/best.toml"]
    assert following(vsajax(*following(tuned), "--duration", "0.1")) == ["init", "--list"]
    exported = vsajax("export", study, "--to", "toml", "-o", "d", "--duration", "0.1")
    assert following(exported) == ["export", "d", "--check"]
    population = vsajax("montecarlo", study, "-o", "runs/m", "--scenarios", "4", "--set", "tune={}", *one)
    assert following(population) == ["report", "runs/m"]
    assert following(vsajax("report", "runs/m")) == ["report", "runs/m", "--open"]
    compared = vsajax("compare", study, "runs/t/best.toml", "-s", study, "-o", "runs/c")
    assert following(compared) == ["report", "runs/c"]
    pareto = vsajax("tune", study, "-o", "runs/p", "--method", "pareto", "--trials", "4", "--batch", "4")
    assert following(pareto) == ["report", "runs/p"]
    typed = following(vsajax("stiffness", "shipped:arm"))
    assert typed == ["workspace", "shipped:arm", "-o", "runs/workspace"]
    swing = vsajax("simulate", "shipped:damping", "-o", "swing.parquet")
    assert following(swing)[0] in {"tune", "sweep", "montecarlo"}


@pytest.mark.failure
def test_a_search_that_no_longer_fits_is_not_proposed(here):
    path = Path("my study.toml")
    assert improve(load_study(path), path)[0] == "tune"
    # The forgetting that would be tuned is not there any more.
    settings = ["estimator.fit={ prior_scale = 1.0 }"]
    assert improve(load_study(path, settings, unused=("sweep", "tune")), path, settings)[0] == "export"
