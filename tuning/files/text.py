"""Text that a user wrote and that is shown on a line: names, and the names of files."""

from __future__ import annotations

from typing import Annotated

import pydantic

from tuning.files.errors import is_unseen


def plain(text: str, instead: str = "?") -> str:
    """Return a text as one line in which every character is shown where it stands."""
    return "".join(instead if is_unseen(letter) else letter for letter in text)


def _check_plain(text: str) -> str:
    wrong = next((letter for letter in text if is_unseen(letter)), None)
    if wrong is not None:
        raise ValueError(
            f"got {text!a}; has the character U+{ord(wrong):04X}, which is a line end, a control character or a "
            "mark of direction: remove it"
        )
    return text


Line = Annotated[str, pydantic.AfterValidator(_check_plain), pydantic.Field(max_length=200)]
"""A name in a TOML file: one line of characters that are shown where they stand."""
