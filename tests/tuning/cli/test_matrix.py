"""Every command on every kind of study: it runs where the kind has what it needs, else it is refused in words.

What a kind has says what a command supports; the table of docs/architecture.md is compared with it.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.tuning.cli.reaching import Reached, reach
from tests.tuning.logs.motor_log import write_study
from tuning.files.shipped import shipped_files
from tuning.study.base import Study, resolved, to_toml
from tuning.study.kinds import Kind, all_kinds, kind_of
from tuning.study.loading import load_study
from tuning.study.paths import contested_number, numeric_paths
from tuning.study.scores import time_of

KINDS = ("log", "serial", "sea", "antagonistic", "damping", "arm")

_OWN = {"stiffness": (), "workspace": ("-o", "run"), "poses": ("-o", "run")}
"""Commands that the kind "arm" brings along."""
_METHODS = ("gradient", "hybrid", "grid", "tpe", "cmaes", "pareto")
COMMANDS: dict[str, tuple[str, ...]] = {
    "check": ("check", "{file}"),
    "simulate": ("simulate", "{file}", "-o", "r.csv"),
    "sweep": ("sweep", "{file}", "-o", "run", "{grid}"),
    "sweep --workers": ("sweep", "{file}", "-o", "run", "{grid}", "--workers", "2"),
    **{f"tune --method {m}": ("tune", "{file}", "-o", "run", "--method", m, "{tune}") for m in _METHODS},
    "compare": ("compare", "{config}", "-s", "{file}", "-o", "run"),
    "contest": ("contest", "{file}", "-o", "run", "--trials", "4", "{choices}"),
    "montecarlo": ("montecarlo", "{file}", "-o", "run", "--scenarios", "4"),
    "montecarlo --workers": ("montecarlo", "{file}", "-o", "run", "--scenarios", "4", "--workers", "2"),
    "montecarlo --sensitivity": ("montecarlo", "{file}", "-o", "run", "--scenarios", "4", "--sensitivity", "8"),
    "export": ("export", "{file}", "--to", "json", "-o", "out"),
    **{name: (name, "{file}", *options) for name, options in _OWN.items()},
}


def has(kind: Kind, study: Study, command: str) -> bool:
    """Return whether a kind has what a command needs."""
    if command == "check":
        return True
    if command == "simulate":
        return kind.picture is not None
    if command == "export":
        return kind.deployable is not None
    if command in _OWN:
        return kind.name == "arm"
    if kind.problem is None:
        return False
    if command in {"tune --method gradient", "tune --method hybrid"}:
        return hasattr(kind.problem.load(), "residuals")
    if command == "tune --method pareto":
        return time_of(study.objectives[0]) is not None
    if command.startswith("montecarlo"):
        return not study.no_scenarios() and not (command.endswith("sensitivity") and kind.told is not None)
    return True


def options(study: Study) -> dict[str, tuple[str, ...]]:
    """Return what must be added to a study that does not say it itself."""
    path, own = contested_number(study)
    positive = {name: value for name, value in numeric_paths(study).items() if value > 0.0 and name != path}
    second = next(name for name in positive if name.split(".")[0] in study.contested)
    numbers = {path: own, second: positive[second]}
    bounds = ", ".join(
        f"'{name}'={{low={0.95 * value!r}, high={1.05 * value!r}}}" for name, value in numbers.items()
    )
    choice = f"tune.choices={{size={{own={{}}, other={{'{path}'={1.01 * own!r}}}}}}}"
    return {
        "{grid}": ("--grid", f"{path}={own!r},{1.01 * own!r}"),
        "{tune}": ("--set", f"tune.parameters={{{bounds}}}"),
        "{choices}": ("--set", choice, "--set", "tune.parameters={}"),
    }


@pytest.fixture(scope="module")
def studies(tmp_path_factory) -> dict[str, Path]:
    """Return the file of a study of every kind."""
    files = {name: shipped_files()[f"studies/{name}"] for name in KINDS if name != "log"}
    return {"log": write_study(tmp_path_factory.mktemp("log"))} | files


def rows(studies: dict[str, Path]) -> list[list[str]]:
    """Return the table: commands, and of every kind whether it has what each needs."""
    kinds = [kind for kind in all_kinds() if kind.name in KINDS]
    loaded = {kind.name: load_study(studies[kind.name]) for kind in kinds}
    table = [["command", *loaded]]
    for command in COMMANDS:
        table.append([command, *("yes" if has(kind, loaded[kind.name], command) else "–" for kind in kinds)])
    return table


@pytest.mark.cli
@pytest.mark.failure
@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("name", KINDS)
def test_a_command_runs_where_the_kind_has_what_it_needs(name, command, studies, vsajax, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    reach(monkeypatch)
    study = load_study(studies[name])
    more = options(study)
    config = studies[name]
    if name == "log":
        config = tmp_path.with_name(f"{tmp_path.name}-config") / "own.toml"
        config.parent.mkdir()
        config.write_text(to_toml(resolved(study.deployed())), encoding="utf-8")
    line = [
        word.format(file=studies[name], config=config) if word not in more else more[word]
        for word in COMMANDS[command]
    ]
    words = [part for word in line for part in ((word,) if isinstance(word, str) else word)]
    try:
        ended = vsajax(*words)
        ran = ended.code == 0
    except Reached:
        ran = True
    assert ran == has(kind_of(study), study, command), "" if ran else ended.err
    if not ran:
        assert ended.code == 2
        assert re.search(rf"kind '{name}'|is a study of |names no |of a simulated joint", ended.err), ended.err
        assert list(tmp_path.iterdir()) == []


def test_the_page_on_the_architecture_has_this_table(request, studies):
    page = request.config.rootpath / "docs" / "architecture.md"
    table = rows(studies)
    lines = [f"| {' | '.join(row)} |" for row in table]
    lines.insert(1, "|---" * len(table[0]) + "|")
    assert "\n".join(lines) in page.read_text(encoding="utf-8"), "\n".join(["it should be:", *lines])


def test_every_kind_is_in_the_table():
    assert {kind.name for kind in all_kinds() if kind.tables.startswith("tuning.")} == set(KINDS)
