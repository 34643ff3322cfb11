"""What a user did wrong, said so that it can be put right."""

from __future__ import annotations

from dataclasses import dataclass


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
        text = f"{self.place}: {self.problem}"
        return f"{text}\n    fix: {self.fix}" if self.fix else text


class InputError(ValueError):
    """Bad input from a user: the command line prints it and exits with 2.

    All mistakes that could be found are carried together.
    """

    def __init__(self, *mistakes: Mistake):
        self.mistakes = mistakes
        super().__init__("\n".join(str(mistake) for mistake in mistakes))


def input_error(place: object, problem: str, fix: str = "") -> InputError:
    """Return an `InputError` with a single mistake."""
    return InputError(Mistake(str(place), problem, fix))
