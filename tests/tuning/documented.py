"""The commands that the documents print in ```sh blocks, as the words a shell makes of them."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
_BLOCK = re.compile(r"^```sh\n(.*?)^```", re.DOTALL | re.MULTILINE)


@dataclass(frozen=True)
class Command:
    """One command of a document.

    Args:
        line: in the file, counted from 1.
        words: its words, `vsajax` or another program first; of a pipeline, those before the first bar.
    """

    line: int
    words: tuple[str, ...]


def documents() -> list[Path]:
    """Return the documents of the repository that print commands."""
    found = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
    return [path for path in found if any(commands(path.read_text(encoding="utf-8")))]


def commands(text: str) -> Iterator[Command]:
    """Yield the commands of a document, in order."""
    for block in _BLOCK.finditer(text):
        first = text.count("\n", 0, block.start(1)) + 1
        lines = block[1].split("\n")
        while lines:
            line, taken = lines.pop(0), 1
            while line.endswith("\\"):
                line, taken = line[:-1] + lines.pop(0), taken + 1
            lexer = shlex.shlex(line, posix=True, punctuation_chars="|")
            lexer.whitespace_split = True
            words = list(lexer)
            words = words[: words.index("|")] if "|" in words else words
            while words and re.match(r"^[A-Z_]+=", words[0]):
                words.pop(0)
            if words:
                yield Command(first, tuple(words))
            first += taken
