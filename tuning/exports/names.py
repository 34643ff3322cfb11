"""Names that mean nothing else, wherever an export puts them: in C, C++, MATLAB, Python, YAML, and on a disk."""

from __future__ import annotations

import configparser
import keyword
import re
from functools import cache
from pathlib import Path

from tuning.exports.rendering import TEMPLATES
from tuning.files.errors import input_error

LONGEST = 48
"""Letters of a name; with what is put behind it, C still tells two of them apart (63)."""


@cache
def words(section: str) -> tuple[str, ...]:
    """Return the words of one section of `reserved.ini`."""
    lists = configparser.ConfigParser(interpolation=None)
    lists.read_string(Path(__file__).with_name("reserved.ini").read_text(encoding="utf-8"))
    return tuple(lists[section]["words"].split())


@cache
def _reserved() -> frozenset[str]:
    """Return every name that must not be an export's."""
    maths = {f"{function}{suffix}" for function in words("maths") for suffix in ("", "f", "l")}
    listed = {
        word for section in ("keywords", "headers", "library", "others", "generated") for word in words(section)
    }
    return frozenset(maths | listed | {word.lower() for word in keyword.kwlist} | _of_templates())


def _of_templates() -> set[str]:
    """Return every identifier in the code of the templates, comments and what is filled in left out."""
    found: set[str] = set()
    for path in (*TEMPLATES.glob("*.c.jinja"), *TEMPLATES.glob("*.h.jinja")):
        text = path.read_text(encoding="utf-8")
        text = re.sub(r"/\*.*?\*/|\{%.*?%\}|\w*\{\{.*?\}\}\w*|\"[^\"\n]*\"|//[^\n]*", " ", text, flags=re.DOTALL)
        found |= {word.lower() for word in re.findall(r"\b[A-Za-z_]\w*", text)}
        found.add(path.name.partition(".")[0])
    return found


def identifier_of(text: str) -> str:
    """Return a text as a name that can stand everywhere.

    It is a lower-case identifier of at most `LONGEST` letters without two underscores in a row, and means nothing
    in C, C++, their libraries, MATLAB, Python, YAML, on a disk of Windows, or in what is generated.
    """
    clean = _cleaned(text)
    if not clean[:1].isalpha() or clean in _reserved() or re.match(r"fmi\d", clean):
        clean = _cleaned(f"joint_{clean}")
    if clean.endswith(words("endings")):
        clean = clean[: LONGEST - len("_joint")].rstrip("_") + "_joint"
    return clean


def _cleaned(text: str) -> str:
    return re.sub(r"[\W_]+", "_", text, flags=re.ASCII).strip("_").lower()[:LONGEST].rstrip("_")


def checked_name(text: str, place: str) -> str:
    """Return a name that the user gave.

    Raises:
        InputError: it cannot stand everywhere as it is.
    """
    fit = identifier_of(text)
    if fit == text:
        return text
    raise input_error(
        place,
        f"got {text!a}; must be an identifier of C in lower case, of at most {LONGEST} letters, without __, "
        "that means nothing else in C, C++, their libraries or the generated files",
        f"e.g. {place} {fit}",
    )
