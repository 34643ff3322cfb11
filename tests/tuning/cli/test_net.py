"""Every command on every shipped file, and on what is no file of the lab: it runs or says why not."""

from __future__ import annotations

import itertools
import re

import pytest

from tests.tuning.cli.reaching import Reached, reach, write_log
from tuning.files import kinds
from tuning.files.kinds import kind_of
from tuning.files.shipped import shipped_files
from tuning.files.toml import read_toml

TAKES = {
    "check": [("check", "{file}")],
    "simulate": [("simulate", "{file}", "-o", "r.csv")],
    "estimate": [("estimate", "log.csv", "-c", "{file}", "-o", "e.csv")],
    "map": [("estimate", "log.csv", "-c", "shipped:tuned/sea_sensor", "--map", "{file}", "-o", "e.csv")],
    "sweep": [
        ("sweep", "{file}", "-o", "run"),
        ("sweep", "{file}", "-o", "run", "--dry-run"),
        ("sweep", "{file}", "-o", "run", "--grid", "estimator.fit.prior_scale=1,2"),
    ],
    "tune": [
        ("tune", "{file}", "-o", "run", "--method", method)
        for method in ("gradient", "grid", "hybrid", "tpe", "cmaes", "pareto")
    ],
    "montecarlo": [
        ("montecarlo", "{file}", "-o", "run", "--scenarios", "4"),
        ("montecarlo", "{file}", "-o", "run", "--scenarios", "4", "--sensitivity", "8"),
        ("montecarlo", "{file}", "-o", "run", "--scenarios", "4", "--dry-run"),
    ],
    "compare": [
        ("compare", "{file}", "{file}", "-s", "{file}", "-o", "run"),
        ("compare", "{file}", "-s", "shipped:serial", "-o", "run"),
        ("compare", "shipped:serial", "-s", "{file}", "-o", "run"),
    ],
    "contest": [("contest", "{file}", "-o", "run", "--trials", "4")],
    "export": [("export", "{file}", "--to", "json", "-o", "out")],
    "recheck": [("export", "{file}", "--check")],
    "stiffness": [("stiffness", "{file}")],
    "workspace": [("workspace", "{file}", "-o", "run")],
    "poses": [("poses", "{file}", "-o", "run")],
    "report": [("report", "{file}")],
    "recording": [("estimate", "{file}", "-c", "shipped:serial", "-o", "e.csv")],
}
"""Every place of a command line where a file can be named."""

RUNS = {
    kinds.STUDY: {"check", "simulate", "montecarlo", "export"},
    kinds.CONFIG: {"check", "export"},
    kinds.ARM_STUDY: {"check", "stiffness", "workspace", "poses", "montecarlo", "export"},
    kinds.SIGNAL_MAP: {"check"},
    kinds.LOG_STUDY: {"check", "estimate"},
    kinds.JOINT: {"check"},
    kinds.ARM: {"check"},
}
"""What must not be refused."""

_OF_PYDANTIC = re.compile(r": (unknown key|is missing)\n")


def outcome(vsajax, line: tuple[str, ...]) -> str:
    """Return "runs", or the words of a refusal; fail where it is no refusal in words of its own."""
    try:
        ended = vsajax(*line)
    except Reached:
        return "runs"
    if ended.code == 0:
        return "runs"
    said = f"vsajax {' '.join(line)}:\n{ended.err}"
    assert (ended.code, ended.out) == (2, ""), said
    assert "Traceback" not in ended.err, said
    mistakes = ended.err.count("error: ")
    assert mistakes or ended.err.startswith("Usage: "), said
    # A list of keys says that the file was taken for what it is not.
    assert len(_OF_PYDANTIC.findall(ended.err)) < max(2, mistakes), said
    assert "fix: " in ended.err or "Error: " in ended.err or mistakes > 1, said
    return ended.err


@pytest.fixture
def reached(vsajax, tmp_path, monkeypatch):
    """Run a command line in an empty folder with a log, as far as what computes."""
    monkeypatch.chdir(tmp_path)
    reach(monkeypatch)
    write_log(tmp_path / "log.csv", "sea")
    return lambda line: outcome(vsajax, line)


@pytest.mark.cli
@pytest.mark.failure
@pytest.mark.parametrize("name", shipped_files())
def test_every_command_takes_a_shipped_file_or_says_why_not(name, reached, tmp_path):
    file = f"shipped:{name}"
    tables = read_toml(shipped_files()[name])
    kind = kind_of(tables)
    if tables.get("kind") in {"serial", "sea", "antagonistic"}:
        write_log(tmp_path / "log.csv", tables["kind"])
    assert kind is not None
    ran = {
        command
        for command, lines in TAKES.items()
        for line in lines
        if reached(tuple(word.format(file=file) for word in line)) == "runs"
    }
    assert RUNS[kind] <= ran
    if kind is kinds.STUDY:
        has = {"sweep": "sweep", "tune": "tune"}
        assert {
            table for table in has if tables.get(table, {}).get("grid" if table == "sweep" else "parameters")
        } <= ran
        assert ("estimate" in ran) == ("estimator" in tables)
    elif kind is kinds.CONFIG:
        assert {"estimate", "compare"} & ran
    elif kind is kinds.LOG_STUDY:
        # Nothing is simulated or drawn, and nothing leaves the lab before it is tuned.
        assert not ran - {"check", "estimate", "sweep", "tune", "compare", "contest"}
    elif kind in (kinds.JOINT, kinds.ARM):
        assert ran == {"check"}


NO_STUDY = {
    "nothing.toml": "",
    "words.toml": "these are no tables",
    "tables.toml": "[a]\nb = 1\n",
    "robot.urdf": '<robot name="r"><link name="l"/></robot>',
    "log.parquet": "PAR1",
    "folder": None,
}


@pytest.mark.cli
@pytest.mark.failure
@pytest.mark.parametrize("name", [*NO_STUDY, "not there.toml"])
def test_every_command_says_what_is_wrong_with_what_is_no_file_of_the_lab(name, reached, tmp_path):
    text = NO_STUDY.get(name, "")
    if text is None:
        (tmp_path / name).mkdir()
    elif name in NO_STUDY:
        (tmp_path / name).write_text(text)
    for line in itertools.chain(*TAKES.values()):
        assert name in reached(tuple(word.format(file=name) for word in line))
