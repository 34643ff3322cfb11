"""The command line inside the test process, and compiled programs kept out of the user's home."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import NamedTuple

import pytest

from tuning import runtime
from tuning.cli.main import run


class Ended(NamedTuple):
    """How a command ended, and what it printed."""

    code: int
    out: str
    err: str


@pytest.fixture(scope="session", autouse=True)
def _cache(tmp_path_factory):
    # One folder for all workers of a run: their subprocesses need not compile a program twice.
    base = tmp_path_factory.getbasetemp()
    folder = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("VSAJAX_CACHE", str(folder / "compiled"))
        yield


@pytest.fixture
def vsajax(monkeypatch, capsys) -> Callable[..., Ended]:
    """Run a command line in this process, whose jax `tests/conftest.py` has configured already."""
    monkeypatch.setattr(runtime, "start_jax", lambda: None)

    def call(*arguments: object) -> Ended:
        capsys.readouterr()
        code = run([str(argument) for argument in arguments])
        return Ended(code, *capsys.readouterr())

    return call
