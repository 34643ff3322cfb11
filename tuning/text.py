"""Text that a user wrote and that is shown on a line: names, and the names of files."""

from __future__ import annotations

import unicodedata
from typing import Annotated

import pydantic

_HIDDEN = {"Cc", "Cf", "Cs", "Zl", "Zp"}
"""Unicode categories of characters that are not shown or move what is: controls, line ends, marks of direction."""


def _is_plain(letter: str) -> bool:
    return unicodedata.category(letter) not in _HIDDEN


def plain(text: str, instead: str = "?") -> str:
    """Return a text as one line in which every character is shown where it stands."""
    return "".join(letter if _is_plain(letter) else instead for letter in text)


def _check_plain(text: str) -> str:
    wrong = next((letter for letter in text if not _is_plain(letter)), None)
    if wrong is not None:
        raise ValueError(
            f"got {text!a}; has the character U+{ord(wrong):04X}, which is a line end, a control character or a "
            "mark of direction: remove it"
        )
    return text


Line = Annotated[str, pydantic.AfterValidator(_check_plain), pydantic.Field(max_length=200)]
"""A name in a TOML file: one line of characters that are shown where they stand."""
