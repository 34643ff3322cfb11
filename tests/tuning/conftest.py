"""The command line inside the test process."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from importlib import invalidate_caches
from pathlib import Path
from typing import NamedTuple
from unittest.mock import patch

import pytest

from tuning.cli.main import run
from tuning.exports.formats.registry import FORMATS
from tuning.papers import PAPERS
from tuning.runs import machine
from tuning.runs.workers import planner_of
from tuning.study import plugins, registry
from tuning.study.kinds import KINDS
from tuning.study.parts.catalog import SLOTS
from tuning.study.scores import SCORES

MADE_UP = {"air_joint", "evil", "broken", "acme", "other"}
"""Modules that tests bring in."""


class Ended(NamedTuple):
    """How a command ended, and what it printed."""

    code: int
    out: str
    err: str


@pytest.fixture
def vsajax(monkeypatch, capsys) -> Callable[..., Ended]:
    """Run a command line in this process, whose jax `tests/conftest.py` has configured already."""
    monkeypatch.setattr(machine, "start_jax", lambda: None)

    def call(*arguments: object) -> Ended:
        capsys.readouterr()
        code = run([str(argument) for argument in arguments])
        return Ended(code, *capsys.readouterr())

    return call


def forget_modules() -> None:
    """Take what tests brought in out of this process, as if it had not been imported."""
    for name in [name for name in sys.modules if name.partition(".")[0] in MADE_UP]:
        del sys.modules[name]
    invalidate_caches()


@pytest.fixture
def forgotten(monkeypatch, tmp_path) -> Iterator[None]:
    """Undo what a test brings in: tags, modules, consent."""
    monkeypatch.delenv("VSAJAX_PLUGINS", raising=False)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    registries = [*SLOTS.values(), KINDS, SCORES, FORMATS, PAPERS]
    patches = [patch.dict(one._added) for one in registries] + [patch.dict(registry._LOADED)]
    for one in patches:
        one.start()
    yield
    for one in patches:
        one.stop()
    forget_modules()
    planner_of.cache_clear()
    plugins._installed.cache_clear()


@pytest.fixture
def site(forgotten, tmp_path, monkeypatch) -> Path:
    """A folder of the path into which packages are installed."""
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    return folder
