"""The files of one recording as a single set of columns, whatever rows they share."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tuning.files.errors import InputError, Mistake
from tuning.logs.columns import LogFile
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
        found, seen = [], set()
        for stream in self.streams:
            found += [name for name in stream.names if (stream.path, name) not in seen]
            # Only what parts of one table share is told once; two columns of one name are told twice.
            seen |= {(stream.path, name) for name in stream.shared}
        return found

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
        by_file = [s for s in self.streams if s.path.name == file and column in s.names]
        if by_file:
            return 1 if column in by_file[0].shared else sum(s.names.count(column) for s in by_file)
        return self.names.count(name)

    def main(self, clock: str, columns: Iterable[str]) -> LogFile:
        """Return the stream whose stamps are the clock's.

        Where parts of one table share them, it is the longest of those that hold some of `columns`.
        """
        first = self.of(clock)
        if clock not in first.shared:
            return first
        held = [self.of(column) for column in columns if self.count(column)]
        parts = [s for s in held if s.path == first.path and clock in s.shared]
        return max(parts, key=lambda s: s.table.num_rows, default=first)

    @property
    def unread(self) -> dict[str, str]:
        """Topics that could not be read, with their types."""
        return {topic: kind for stream in self.streams for topic, kind in stream.unread.items()}

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
