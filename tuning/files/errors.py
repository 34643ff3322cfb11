"""What a user did wrong, said so that it can be put right."""

from __future__ import annotations

import unicodedata
from dataclasses import dataclass

_UNSEEN = {"Cc", "Cf", "Cs", "Zl", "Zp"}
"""Categories of characters that steer a terminal, turn text around or break lines: they are named, not sent."""


def is_unseen(letter: str) -> bool:
    """Return whether a character steers a terminal, turns text around or breaks a line."""
    return unicodedata.category(letter) in _UNSEEN


def printable(text: str) -> str:
    r"""Return text on one line that a terminal shows and does not obey, e.g. ``\x1b`` for an escape."""
    if text.isascii() and text.isprintable():
        return text
    return "".join(letter.encode("unicode_escape").decode() if is_unseen(letter) else letter for letter in text)


_LONGEST = 2000
"""Characters of what is said of one mistake; somebody else's file may hold a text of megabytes."""


def shortened(text: str) -> str:
    """Return a text, or the beginning and the end of one that nobody would read."""
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST // 2]} … {text[-_LONGEST // 2 :]}"


@dataclass(frozen=True)
class Mistake:
    """One mistake in a user's input.

    Args:
        place: file, key or line, e.g. ``study.toml: joint.link.inertia``.
        problem: what was got and what is allowed.
        fix: the way out; empty where the problem already says it.
    """

    place: str
    problem: str
    fix: str = ""

    def __str__(self) -> str:
        text = printable(shortened(f"{self.place}: {self.problem}"))
        return f"{text}\n    fix: {printable(shortened(self.fix))}" if self.fix else text


class InputError(ValueError):
    """Bad input from a user: the command line prints it and exits with 2.

    All mistakes that could be found are carried together.
    """

    def __init__(self, *mistakes: Mistake):
        self.mistakes = mistakes
        super().__init__("\n".join(str(mistake) for mistake in mistakes))

    def __reduce__(self) -> tuple[type[InputError], tuple[Mistake, ...]]:
        # A worker's error is one here too.
        return InputError, self.mistakes


def input_error(place: object, problem: str, fix: str = "") -> InputError:
    """Return an `InputError` with a single mistake."""
    return InputError(Mistake(str(place), problem, fix))
