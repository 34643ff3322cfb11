"""Progress is for people at a terminal, and only on stderr."""

from __future__ import annotations

import sys

import pytest

from tuning.terminal.progress import progress


def printed(capsys, *, quiet: bool) -> tuple[str, str]:
    with progress("sweep 6 × 2", 3, quiet=quiet) as advance:
        advance()
        advance(2)
    return capsys.readouterr()


@pytest.mark.parametrize(("is_terminal", "quiet"), [(False, False), (False, True), (True, True)])
def test_nothing_is_shown_to_a_file_or_to_who_wants_quiet(is_terminal, quiet, capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: is_terminal)
    assert printed(capsys, quiet=quiet) == ("", "")


def test_a_terminal_is_shown_what_runs_and_how_far_it_is(capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    out, err = printed(capsys, quiet=False)
    assert out == ""
    assert "sweep 6 × 2" in err
    assert "100%" in err
