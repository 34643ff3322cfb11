"""The files of one recording as a single set of columns, whatever rows they share."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tuning.errors import InputError, Mistake
from tuning.logs.files import LogFile
from tuning.logs.formats import read_streams
from tuning.logs.layout import AS_FOUND, FileFormat


@dataclass(frozen=True)
class Log:
    """A log.

    Args:
        path: of its first file.
        streams: its columns, by the rows they share.
    """

    path: Path
    streams: tuple[LogFile, ...]

    @property
    def names(self) -> list[str]:
        """The names of all columns."""
        return [name for stream in self.streams for name in stream.names]

    @property
    def notes(self) -> list[str]:
        """What was found in its files and not told."""
        several = len({stream.path for stream in self.streams}) > 1
        said = (f"{s.path.name}: {note}" if several else note for s in self.streams for note in s.notes)
        return list(dict.fromkeys(said))

    def of(self, name: str) -> LogFile:
        """Return the stream that holds a column; `file.csv:column` asks for that of one file of several."""
        file, _, column = name.partition(":")
        by_file = [s for s in self.streams if s.path.name == file and column in s.names]
        return (by_file or [s for s in self.streams if name in s.names])[0]

    def count(self, name: str) -> int:
        """Return how many columns have a name."""
        file, _, column = name.partition(":")
        by_file = sum(s.names.count(column) for s in self.streams if s.path.name == file)
        return by_file or self.names.count(name)

    def nearest(self, name: str) -> str | None:
        """Return the column whose name is most like `name`, capitals apart, if any is."""
        by_lower = {known.lower(): known for known in self.names}
        near = difflib.get_close_matches(name.lower(), by_lower, 1)
        return by_lower[near[0]] if near else None


def column_in(stream: LogFile, name: str) -> str:
    """Return the name that a column, perhaps asked for as `file.csv:column`, has in its own stream."""
    return name if name in stream.names else name.partition(":")[2]


def open_log(path: Path, join: Sequence[str] = (), told: FileFormat = AS_FOUND) -> Log:
    """Return the columns of a log and of the files that join it, which lie in its folder.

    Args:
        path: of the first file.
        join: names of the others.
        told: how text files are laid out, as far as it is known.

    Raises:
        InputError: a file cannot be read; carries the mistakes of all.
    """
    streams: list[LogFile] = []
    mistakes: list[Mistake] = []
    for file in (path, *(path.parent / name for name in join if path.parent / name != path)):
        try:
            streams += read_streams(file, told)
        except InputError as error:
            mistakes += error.mistakes
    if mistakes:
        raise InputError(*mistakes)
    return Log(path, tuple(streams))
