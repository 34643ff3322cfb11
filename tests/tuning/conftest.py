"""The command line inside the test process."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import pytest

from tuning.cli.main import run
from tuning.runs import machine


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
