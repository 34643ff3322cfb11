"""Every command that a document prints works: options, settings, and the files that it is given to work on.

A document is a session: its commands run in one folder, in their order, on files that it made before or that
ship. In the default run all is real up to what computes; `make test-all` computes too, made short by `SHORT`.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from tests.tuning.cli.reaching import Reached, reach, write_log
from tests.tuning.documented import ROOT, Command, commands, documents
from tests.tuning.plugin import install_example
from tuning.cli.main import cli
from tuning.files.kinds import LOG_STUDY, kind_of
from tuning.files.toml import read_toml
from tuning.kinds.estimation.study import EstimationStudy
from tuning.problem.replay import member
from tuning.study.base import resolved, to_toml
from tuning.study.loading import load_study

OTHER_PROGRAMS = {"make", ".", "python", "pip", "git", "cd", "dask", "eval"}
"""They are no business of this test: `make` has its own, the generated Python is run by the export checks."""

USERS = {
    "README.md": {"log.csv": "serial", "signals.toml": "map"},
    "damping.md": {"law.toml": "damping"},
    "logs.md": {"runs/robot.csv": "serial", "runs/robot.toml": "map"},
}
"""Files that a document supposes its reader to have, and what they are."""

SHORT = {
    "sweep": ("--scenarios", "2", "--set", "clock.duration=0.5"),
    "tune": ("--starts", "1", "--budget", "2", "--set", "clock.duration=0.5", "--set", "tune.max_steps=2"),
    "montecarlo": (
        "--scenarios",
        "8",
    ),
    "simulate": ("--set", "clock.duration=0.5"),
    "contest": ("--trials", "4", "--batch", "4"),
    "compare": ("--scenarios", "4"),
    "export": ("--duration", "0.2"),
}
"""What is put behind a command, so that a whole document runs in minutes: less of the same."""
SHORT_ARM = {
    "sweep": ("--scenarios", "2"),
    "tune": ("--trials", "4", "--batch", "4", "--set", "scenarios={train=4, held_out=4}"),
}
"""The same for a study without a clock."""


def _map_of(kind: str) -> str:
    from tuning.logs.signal_map import canonical_map, signals_of

    present = {name for name in signals_of(kind) if not name.startswith("true_")}  # pyright: ignore
    return to_toml(canonical_map(kind, present).model_dump(exclude_none=True))  # pyright: ignore


def furnish(document: Path, folder: Path) -> None:
    """Put into a folder what a document's reader has: the repository's test data, and files of their own."""
    for name in ("tests", "examples"):
        (folder / name).symlink_to(ROOT / name)
    for name, kind in USERS.get(document.name, {}).items():
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        if kind == "map":
            path.write_text(_map_of("serial"))
        elif path.suffix == ".csv":
            write_log(path, kind)
        else:
            path.write_text(to_toml(resolved(load_study(Path(f"shipped:{kind}")))))


def pretend(words: tuple[str, ...]) -> None:
    """Leave what a command would have written, so that those after it find it."""
    name, *rest = words
    given = cli.commands[name].make_context(name, rest, parent=cli.make_context("vsajax", [name])).params
    output = given.get("folder") or given.get("output")
    if name == "simulate":
        study = load_study(given["study"], given["settings"])
        assert output is not None
        if isinstance(study, EstimationStudy):
            write_log(output, study.kind)
        if study.population.paths:
            output.with_suffix(".toml").write_text(to_toml(resolved(member(study, 0))))
    elif name in {"sweep", "tune", "contest", "montecarlo"} and not given.get("dry_run"):
        assert output is not None
        output.mkdir(parents=True, exist_ok=True)
        kind = kind_of(read_toml(given["study"]))
        assert kind is not LOG_STUDY
        (output / "best.toml").write_text(to_toml(resolved(load_study(given["study"], given["settings"]))))
    elif name in {"export", "stiffness", "workspace", "poses"} and output is not None:
        output.mkdir(parents=True, exist_ok=True)


@pytest.mark.contract
@pytest.mark.parametrize("document", documents(), ids=lambda path: path.name)
def test_every_documented_command_is_taken(document, vsajax, site, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if document.name == "plugins.md":
        install_example(site)
    furnish(document, tmp_path)
    reach(monkeypatch)
    for command in commands(document.read_text(encoding="utf-8")):
        program, *rest = command.words
        if program in OTHER_PROGRAMS:
            continue
        said = f"{document.name}:{command.line}: {' '.join(command.words)}"
        assert program == "vsajax", said
        words = tuple(rest)
        if _needs_machines(words):
            cli.commands[words[0]].make_context(
                words[0], list(words[1:]), parent=cli.make_context("vsajax", [words[0]])
            )
            continue
        if words[0] == "report" or (words[0] == "export" and "--to" not in words):
            # They read what a run has computed; the slow test has that.
            given = (
                cli.commands[words[0]]
                .make_context(words[0], list(words[1:]), parent=cli.make_context("vsajax", [words[0]]))
                .params
            )
            assert (given.get("run") or given["config"]).is_dir(), said
            continue
        try:
            ended = vsajax(*words)
        except Reached:
            pretend(words)
            continue
        assert (ended.code, ended.err) == (0, ""), f"{said}\n{ended.err}"


@pytest.mark.slow(twin="test_every_documented_command_is_taken")
@pytest.mark.cli
@pytest.mark.parametrize("document", documents(), ids=lambda path: path.name)
def test_every_documented_command_runs(document, vsajax, site, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if document.name == "plugins.md":
        install_example(site)
    furnish(document, tmp_path)
    ran = [c for c in commands(document.read_text(encoding="utf-8")) if c.words[0] == "vsajax" and _is_run(c)]
    for command in ran:
        more = _shortened(command.words[1:])
        ended = vsajax(*command.words[1:], *more)
        said = f"{document.name}:{command.line}: {' '.join(command.words)} {' '.join(more)}"
        assert ended.code == 0, f"{said}\n{ended.out}\n{ended.err}"


def _is_run(command: Command) -> bool:
    """Return whether a command is run here: papers and timings have tests of their own, clusters none."""
    return command.words[1] not in {"reproduce", "bench"} and not _needs_machines(command.words)


def _needs_machines(words: tuple[str, ...]) -> bool:
    return "--scheduler" in words or "slurm" in words


def _shortened(words: tuple[str, ...]) -> tuple[str, ...]:
    """Return what is put behind a command; what goes on with a run gets what its beginning got."""
    if words[1:2] == ("arm.toml",) and words[0] in SHORT_ARM:
        return SHORT_ARM[words[0]]
    if "--method" in words and not {"gradient", "hybrid"} & set(words):
        return ("--set", "clock.duration=0.5")
    if "--sensitivity" in words:
        return (*SHORT["montecarlo"], "--sensitivity", "8", "--set", "clock.duration=2.5")
    if words[0] == "tune" and any("population" in word for word in words):
        # Judged by what settles, from 2 s on.
        return (*SHORT["tune"], "--set", "clock.duration=2.5")
    if words[0] == "export" and "--to" not in words:
        return ()
    return SHORT.get(words[0], ())


@pytest.mark.structure
def test_every_fence_of_a_command_is_one_that_is_tested():
    for document in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]:
        fence = None
        for number, line in enumerate(document.read_text(encoding="utf-8").splitlines(), 1):
            if line.startswith("```"):
                fence = None if fence is not None else line[3:]
            elif fence is not None and fence != "sh":
                assert not line.startswith("vsajax "), f"{document.name}:{number}: print it in a ```sh block"


@pytest.mark.structure
def test_words_are_those_of_a_shell():
    text = "a\n```sh\nA=1 vsajax x 'b c' \\\n  d  # e\n\nvsajax y | z\n```\n"
    assert [(c.line, c.words) for c in commands(text)] == [(3, ("vsajax", "x", "b c", "d")), (6, ("vsajax", "y"))]
    assert tomllib.loads(_map_of("serial"))["kind"] == "serial"


@pytest.mark.contract
@pytest.mark.parametrize(
    "document", [*sorted((ROOT / "docs").glob("*.md")), ROOT / "README.md"], ids=lambda p: p.name
)
def test_every_command_within_a_sentence_has_the_options_that_it_names(document):
    for span in re.findall(r"`vsajax ([^`]+)`", document.read_text(encoding="utf-8")):
        name, *words = span.split()
        if name.startswith("-") or name.isupper():
            continue
        assert name in cli.commands, span
        known = {option for parameter in cli.commands[name].params for option in parameter.opts} | {"--help"}
        named = {re.split(r"[=,.;]", word)[0] for word in words if re.match(r"--?[a-z]", word)}
        assert named <= known, f"{document.name}: `vsajax {span}`"
