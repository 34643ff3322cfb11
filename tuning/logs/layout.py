"""How a text file of columns is laid out: told by the `[file]` table of a signal map, else by its lines.

What a file leaves open is not decided here: it is refused with the key that decides it.
"""

from __future__ import annotations

import codecs
import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import pydantic

from tuning.files.errors import input_error
from tuning.files.toml import Table
from tuning.logs.numerals import decimal_mark, grouped_pattern, is_date, is_number

SEPARATORS = (",", ";", "\t", "|", " ")
COMMENTS = ("#", "%", "//")
_SAMPLE = 120
"""Lines looked at from the beginning, the middle and the end each."""
_LONGEST_PREAMBLE = 60
_FEW_ROWS = 10
_NUMERIC = 0.5
"""Share of its cells from which a column is one of numbers."""
_MARKS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars", " ": "blanks"}
_UNIT = re.compile(
    r"(?:[munk]?(?:s|rad|n[.*· ]?m|n|a|v|w|hz|m|g)|sec|secs|seconds?|msec|usec|nsec|µs|"
    r"deg|degrees?|°|°c|c|k|rpm|revs?|turns?|counts?|cts|ticks?|%|-|–|1|bool|none|[mµ]m|n[.*· ]?cm|"
    r"radians?|amps?|volts?|newton[- ]?met(?:er|re)s?)(?:[/·*^ ]?(?:s|s²|s\^?2|rad|deg|m|a|v|1|2|-1|-2))*",
    re.IGNORECASE,
)


class FileFormat(Table):
    """The `[file]` table of a signal map; what is absent is found from the file and said.

    Args:
        encoding: of the text, by any name Python knows.
        separator: between columns; a blank stands for any number of blanks and tabs.
        decimal: mark.
        thousands: mark between groups of three digits.
        comment: what lines to be left out begin with.
        header: the line (from 1) of the column names; 0 where there is none.
        columns: their names where there is no header, or in its place.
        units: whether the line after the header holds units.
        split_rows: whether each row is filled by some of the columns only, e.g. by one topic of several.
    """

    encoding: str | None = None
    separator: Literal[",", ";", "\t", "|", " "] | None = None
    decimal: Literal[".", ","] | None = None
    thousands: Annotated[str, pydantic.Field(min_length=1, max_length=1, pattern=r"[^0-9A-Za-z+\-]")] | None = None
    comment: Annotated[str, pydantic.Field(min_length=1)] | None = None
    header: Annotated[int, pydantic.Field(ge=0)] | None = None
    columns: Annotated[list[str], pydantic.Field(min_length=1)] | None = None
    units: bool | None = None
    split_rows: bool | None = None

    @pydantic.field_validator("encoding")
    @classmethod
    def _known(cls, encoding: str | None) -> str | None:
        try:
            return encoding and codecs.lookup(encoding).name
        except LookupError:
            raise ValueError(f'got {encoding!r}; known are "utf-8", "utf-16", "cp1252", "latin-1", …') from None

    @pydantic.model_validator(mode="after")
    def _consistent(self) -> FileFormat:
        if self.decimal is not None and self.decimal == self.thousands:
            raise ValueError(f"decimal and thousands are both {self.decimal!r}")
        if self.columns is not None and len(set(self.columns)) < len(self.columns):
            raise ValueError("columns has a name twice")
        return self


AS_FOUND = FileFormat()
"""Nothing told."""


@dataclass(frozen=True)
class Layout:
    """A text file, laid out.

    Args:
        names: of the columns.
        units: of the columns, where a line of the file holds them.
        separator: between the cells of a row.
        decimal: mark.
        is_proven: whether a cell or the map leaves no other decimal mark possible.
        rows: the lines of data, each as it is.
        lines: of the file (from 1), on which these begin.
        has_wide_rows: whether a quoted cell runs over several lines.
        notes: sentences on what was found and not told.
        keys: the same as keys of `[file]`.
    """

    names: tuple[str, ...]
    units: tuple[str, ...] | None
    separator: str
    decimal: str
    is_proven: bool
    rows: list[str]
    lines: np.ndarray
    has_wide_rows: bool = False
    notes: tuple[str, ...] = ()
    keys: dict[str, Any] = field(default_factory=dict)


class _Line(NamedTuple):
    number: int
    text: str


def lay_out(path: Path, told: FileFormat = AS_FOUND) -> Layout:
    """Return the layout of a text file.

    Raises:
        InputError: it is no text, has no rows of data, or can be read in two ways; names the key that decides.
        OSError: it cannot be read.
    """
    text, encoding = _decode(path, path.read_bytes(), told)
    # What Excel writes and reads for itself.
    if directive := re.match("sep=([,;\t|])\r?\n", text):
        text = "\n" + text[directive.end() :]
        told = told.model_copy(update={"separator": told.separator or directive[1]})
    lines, comments, has_wide_rows = _split_lines(path, text, told)
    if not lines:
        raise input_error(path, "has no samples", "a header row and one row per sample are needed")
    notes, keys = [], {}
    if encoding != "utf-8" and told.encoding is None:
        keys["encoding"] = encoding
        notes.append(f"its text is not UTF-8: read as {encoding} (file.encoding)")
    sample = _sample(lines if text.endswith(("\n", "\r")) else lines[:-1] or lines)
    separator, width = _find_separator(sample, told)
    cells = [cut(line.text, separator) for line in sample]
    decimal, doubtful = decimal_mark([c for row in cells if len(row) == width for c in row], told.decimal)
    if decimal is None:
        raise input_error(
            f"{path}: {doubtful!r}",
            f"may be {str(doubtful).replace(',', '.')} or {str(doubtful).replace(',', '')}, "
            "and no other cell tells which",
            'set decimal = "," or decimal = "." in [file] of a signal map',
        )
    if separator != ",":
        keys["separator"] = separator
    if decimal != ".":
        keys["decimal"] = decimal
    notes += _said_of_marks(separator, decimal, told)
    found = _Body(path, told, separator, decimal, width, _numeric_columns(cells, width, decimal))
    names, units, first, said, found_keys = found.head(lines, comments)
    keys |= found_keys
    notes += said
    body, said = found.rows(lines[first:], lines[:first], ends_whole=text.endswith(("\n", "\r")))
    notes += said
    if comments:
        here = f"line {comments[0].number}" + (f" and {len(comments) - 1} more" if len(comments) > 1 else "")
        notes.append(f"comments left out: {here}")
    if separator == " ":
        body = [_Line(line.number, "\t".join(cut(line.text, " "))) for line in body]
    return Layout(
        tuple(names),
        None if units is None else tuple(units),
        "\t" if separator == " " else separator,
        decimal,
        any(decimal in cell for row in cells if len(row) == width for cell in row) or told.decimal is not None,
        [line.text for line in body],
        np.array([line.number for line in body], dtype=np.int64),
        has_wide_rows,
        tuple(notes),
        {key: value for key, value in keys.items() if getattr(told, key) is None},
    )


def cut(text: str, separator: str) -> list[str]:
    """Return the cells of a line, without the blanks around them."""
    if separator == " " and '"' not in text:
        return text.split()
    quiet = text.strip() if separator == " " else text
    try:
        row = next(csv.reader([quiet], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:
        # A line break where this separator leaves it outside the quotation marks.
        return [text]
    return [cell.strip() for cell in row]


def is_unit(cell: str) -> bool:
    """Return whether a cell is a unit, in brackets or without."""
    return _UNIT.fullmatch(cell.strip().strip("[]()<>{}").strip()) is not None


def _decode(path: Path, raw: bytes, told: FileFormat) -> tuple[str, str]:
    """Return the text of a file and its encoding."""
    if raw.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
        raise input_error(
            path, "is an Excel workbook or an archive, whatever its name says", "save it as CSV there"
        )
    if raw.startswith((b"\x1f\x8b", b"\x28\xb5\x2f\xfd", b"BZh")):
        raise input_error(path, "is compressed, whatever its name says", "unpack it first")
    encoding = told.encoding or _encoding_of(raw)
    if encoding.startswith("utf-16") and len(raw) % 2:
        raw = raw[:-1]
    try:
        text = raw.decode(encoding).lstrip("\ufeff").rstrip("\0")
    except UnicodeDecodeError as error:
        raise input_error(
            path,
            f"is not {encoding} text: byte {error.start} ({error.reason})",
            "save it as UTF-8, or set encoding in [file] of a signal map",
        ) from None
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise input_error(
            f"{path}: line {line}", "holds NUL characters, as text does not", "was it cut or misnamed?"
        )
    return text, encoding


def _encoding_of(raw: bytes) -> str:
    if raw.startswith((codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE)):
        return "utf-32"
    if raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    start = raw[:4000]
    for encoding, zeros in (("utf-16-le", start[1::2]), ("utf-16-be", start[::2])):
        # Half the bytes of Latin letters and digits in UTF-16 are zero, always the same half.
        if len(start) > 3 and zeros.count(0) > 0.9 * len(zeros):
            return encoding
    try:
        raw.decode("utf-8")
    except UnicodeDecodeError:
        # Where Windows-1252 has no character, Latin-1 still has one.
        return "latin-1" if re.search(rb"[\x81\x8d\x8f\x90\x9d]", raw) else "cp1252"
    return "utf-8"


def _split_lines(path: Path, text: str, told: FileFormat) -> tuple[list[_Line], list[_Line], bool]:
    """Return the filled lines and the comments; a quoted cell may run over several lines of the file."""
    marks = COMMENTS if told.comment is None else (told.comment,)
    lines, comments = [], []
    open_quote: _Line | None = None
    is_wide = False
    if "\r" in text:
        text = text.replace("\r\n", "\n").replace("\r", "\n")
    numbered = map(_Line._make, enumerate(text.split("\n"), 1))
    if '"' not in text and not any(mark in text for mark in marks):
        return [line for line in numbered if line.text and not line.text.isspace()], [], False
    for number, line in numbered:
        if open_quote is not None:
            open_quote = _Line(open_quote.number, f"{open_quote.text}\n{line}")
            if line.count('"') % 2:
                lines.append(open_quote)
                open_quote = None
            continue
        # Not strip(): a row of a tab-separated file may begin or end with an empty cell.
        if not line or line.isspace():
            continue
        if line.lstrip().startswith(marks) and number != told.header:
            comments.append(_Line(number, line.lstrip()))
        elif line.count('"') % 2:
            is_wide, open_quote = True, _Line(number, line)
        else:
            lines.append(_Line(number, line))
    if open_quote is not None:
        raise input_error(
            f"{path}: line {open_quote.number}",
            'opens a quotation mark (") that nothing closes',
            "close or remove it",
        )
    return lines, comments, is_wide


def _sample(lines: Sequence[_Line]) -> list[_Line]:
    if len(lines) <= 3 * _SAMPLE:
        return list(lines)
    middle = len(lines) // 2
    return [*lines[:_SAMPLE], *lines[middle : middle + _SAMPLE], *lines[-_SAMPLE:]]


def _find_separator(sample: Sequence[_Line], told: FileFormat) -> tuple[str, int]:
    """Return the separator by which most cells are numbers or dates, and how many cells most rows then have."""
    best, found = (-1.0, 0.0, 0.0, 0), (",", 1)
    for separator in SEPARATORS if told.separator is None else (told.separator,):
        rows = [cut(line.text, separator) for line in sample]
        # Widths of equal number: the greater, as a header alone may be narrower.
        (width, agreeing) = max(Counter(map(len, rows)).items(), key=lambda item: (item[1], item[0]))
        cells = [cell for row in rows if len(row) == width for cell in row]
        agreement = agreeing / len(rows)
        good = round(sum(map(_is_value, cells)) / max(len(cells), 1) * agreement, 9)
        value = (float(width > 1 and good > 0.0), good, agreement * (width > 1), width)
        if value > best:
            best, found = value, (separator, width)
    return found


def _is_value(cell: str) -> bool:
    if not cell:
        return False
    if is_number(cell) or is_number(cell, ",") or is_date(cell):
        return True
    return any(
        re.match(grouped_pattern(group, mark), cell) for group, mark in ((",", "."), (".", ","), ("'", "."))
    )


def _said_of_marks(separator: str, decimal: str, told: FileFormat) -> list[str]:
    said = []
    if separator != "," and told.separator is None:
        said.append(f"{_MARKS[separator]} between the columns (file.separator)")
    if decimal != "." and told.decimal is None:
        said.append("a decimal comma (file.decimal)")
    return [f"read with {' and '.join(said)}"] if said else []


def _numeric_columns(rows: Sequence[Sequence[str]], width: int, decimal: str) -> list[int]:
    """Return the columns most of whose filled cells are numbers or dates."""
    found = []
    for column in range(width):
        cells = [row[column] for row in rows if len(row) == width and row[column]]
        good = sum(is_number(c, decimal) or _is_value(c) for c in cells)
        if cells and good >= _NUMERIC * len(cells):
            found.append(column)
    return found


@dataclass(frozen=True)
class _Body:
    """What most lines of a file are like, by which its first and last ones are told from them."""

    path: Path
    told: FileFormat
    separator: str
    decimal: str
    width: int
    numeric: list[int]

    def cells(self, line: _Line) -> list[str]:
        return cut(line.text, self.separator)

    def is_data(self, line: _Line) -> bool:
        """Return whether no cell of a line contradicts its being a row of data."""
        cells = self.cells(line)
        if len(cells) != self.width:
            return False
        values = [cells[i] for i in self.numeric if cells[i]]
        return bool(values) and all(_is_value(cell) or cell.lower() in ("nan", "inf", "-inf") for cell in values)

    def is_units(self, line: _Line) -> bool:
        """Return whether a line holds units and nothing else: one at least that is known, and no number."""
        cells = [cell for cell in self.cells(line) if cell]
        bare = [cell.strip("[]()<>{}") for cell in cells]
        return (
            len(self.cells(line)) == self.width
            and any(is_unit(cell) and cell != "1" for cell in bare)
            and not any(_is_value(cell) and cell != "1" for cell in cells)
            and all(len(cell) <= 16 for cell in cells)
        )

    def head(
        self, lines: Sequence[_Line], comments: Sequence[_Line]
    ) -> tuple[list[str], list[str] | None, int, list[str], dict[str, Any]]:
        """Return names, units, how many lines come before the data, notes and keys."""
        at = self._header(lines)
        notes: list[str] = []
        keys: dict[str, Any] = {}
        names, units, first = None, None, 0
        if at is not None:
            names, first = self.cells(lines[at]), at + 1
            if at > 0:
                ends = f"{lines[0].number} to {lines[at - 1].number}"
                notes.append(f"lines {ends} before the header are left out (file.header)")
                keys["header"] = lines[at].number
        elif self.told.header is None and self.told.columns is None:
            names, line = self._commented(lines, comments)
            if names is not None:
                notes.append(f"names of the columns from the comment on line {line} (file.columns)")
                keys["columns"] = names
        is_told = self.told.units
        if (
            at is not None
            and first < len(lines)
            and (is_told or (is_told is None and self.is_units(lines[first])))
        ):
            units = [cell.strip("[]()<>{} ") for cell in self.cells(lines[first])]
            if is_told is None:
                notes.append(
                    f"line {lines[first].number} holds units: {', '.join(u or '–' for u in units)} (file.units)"
                )
                keys["units"] = True
            first += 1
        if self.told.columns is not None:
            names = self.told.columns
        if names is None:
            names = [f"column{number}" for number in range(1, self.width + 1)]
            keys["columns"] = names
            notes.append("it has no header: its columns are called column1, column2, … (file.columns names them)")
        if len(names) == self.width - 1 and self._ends_empty(lines[first:]):
            names = [*names, ""]
            units = units and [*units, ""][: self.width]
        elif len(names) == self.width + 1 and not names[-1]:
            names = names[:-1]
            units = units and units[: self.width]
        return names, units, first, notes, keys

    def _header(self, lines: Sequence[_Line]) -> int | None:
        """Return the place of the header, `None` where there is none."""
        if self.told.header is not None:
            if self.told.header == 0:
                return None
            at = next((i for i, line in enumerate(lines) if line.number == self.told.header), None)
            if at is None:
                raise input_error(
                    f"{self.path}: line {self.told.header}",
                    "is empty or absent, but file.header names it",
                    "mend it",
                )
            return at
        if self.is_data(lines[0]):
            return None
        start = next((i for i, line in enumerate(lines[:_LONGEST_PREAMBLE]) if self.is_data(line)), None)
        if start is None or start == 0:
            return 0
        at = start - 1
        if at > 0 and self.is_units(lines[at]) and len(self.cells(lines[at - 1])) == self.width:
            at -= 1
        # A line as wide as the rows before the header could be a row that is damaged: then the first line is it.
        if (
            any(len(self.cells(line)) == self.width for line in lines[:at])
            or len(self.cells(lines[at])) < self.width
        ):
            at = 0
        return at

    def _commented(self, lines: Sequence[_Line], comments: Sequence[_Line]) -> tuple[list[str] | None, int]:
        """Return the names in one of the last comments above the rows, and its line."""
        before = [comment for comment in comments if comment.number < lines[0].number]
        for comment in reversed(before[-2:]):
            bare = comment.text.lstrip("#%/").strip()
            for separator in (self.separator, ",", " "):
                cells = cut(bare, separator)
                if len(cells) == self.width and not any(map(_is_value, cells)) and not all(map(is_unit, cells)):
                    return cells, comment.number
        return None, 0

    def _ends_empty(self, lines: Sequence[_Line]) -> bool:
        return all(not self.cells(line)[-1] for line in _sample(lines) if len(self.cells(line)) == self.width)

    def rows(
        self, lines: Sequence[_Line], head: Sequence[_Line], *, ends_whole: bool
    ) -> tuple[list[_Line], list[str]]:
        """Return the rows of data: without headers written anew, and without a last line that was cut off."""
        notes = []
        # Only what stands directly above the rows: header and units.
        above = {line.text.strip() for line in head if not self.is_data(line)}
        body = [line for line in lines if line.text.strip() not in above]
        if len(body) < len(lines):
            kept = {line.number for line in body}
            again = [line.number for line in lines if line.number not in kept]
            more = f" and {len(again) - 1} more" if len(again) > 1 else ""
            notes.append(
                f"the header comes again on line {again[0]}{more}: left out; are these several recordings?"
            )
        # With a line end behind it, it may as well be one of few rows that are ragged.
        if len(body) > (_FEW_ROWS if ends_whole else 1) and len(self.cells(body[-1])) < self.width:
            notes.append(f"line {body[-1].number}, the last, is cut off: left out")
            body = body[:-1]
        return body, notes
