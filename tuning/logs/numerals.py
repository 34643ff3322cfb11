"""Numbers written as text: which digits, marks and dates count, strictly, and what they are worth."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute

# Arrow makes these functions when it is imported, where type checkers do not see them.
pc: Any = pyarrow.compute

GROUPING = (
    ",",
    ".",
    "'",
    "\N{RIGHT SINGLE QUOTATION MARK}",
    " ",
    "\N{NO-BREAK SPACE}",
    "\N{NARROW NO-BREAK SPACE}",
)
"""Marks that separate groups of three digits somewhere in the world."""

_EXPONENT = r"(?:[eE][+-]?[0-9]+)?"
_NO_NUMBER = r"[+-]?(?i:nan|inf|infinity)"
_ISO = r"[0-9]{4}-[0-9]{2}-[0-9]{2}[T ][0-9]{2}:[0-9]{2}(?::[0-9]{2}(?:[.,][0-9]{1,9})?)?"
_ZONE = r" ?(?:Z|[+-][0-9]{2}(?::?[0-9]{2})?)"
_TIME_OF_DAY = (
    r"(?:(?P<h>[0-9]{1,2}):(?P<m>[0-9]{2}):(?P<s>[0-9]{2}(?:[.,][0-9]{1,9})?))(?: ?(?P<half>[AaPp][Mm]))?"
)
_MINUTES = r"(?P<m>[0-9]{1,2}):(?P<s>[0-9]{2}[.,][0-9]{1,9})"
_OTHER_DATE = r"(?P<date>[0-9]{1,4}[./-][0-9]{1,2}[./-][0-9]{1,4}),?[ T]"
_LONGEST_INTEGER = 18
"""Digits that surely fit 64 bits."""


def plain_pattern(decimal: str = ".") -> str:
    """Return the pattern of a whole number cell: ASCII digits, one decimal mark, an exponent; NaN and infinity."""
    mark = re.escape(decimal)
    return rf"^(?:[+-]?(?:[0-9]+(?:{mark}[0-9]*)?|{mark}[0-9]+){_EXPONENT}|{_NO_NUMBER})$"


def grouped_pattern(grouping: str, decimal: str) -> str:
    """Return the pattern of a number of at least one thousand, its digits in groups of three."""
    group, mark = re.escape(grouping), re.escape(decimal)
    return rf"^[+-]?[1-9][0-9]{{0,2}}(?:{group}[0-9]{{3}})+(?:{mark}[0-9]*)?{_EXPONENT}$"


def trimmed(cells: pa.ChunkedArray) -> pa.ChunkedArray:
    """Return a column of text without the blanks around its cells."""
    return pc.utf8_trim_whitespace(cells.cast(pa.string()))


def is_number(cell: str, decimal: str = ".") -> bool:
    """Return whether a cell is a number whose digits are not grouped."""
    return re.match(plain_pattern(decimal), cell) is not None


def is_date(cell: str) -> bool:
    """Return whether a cell is a date with its time in ISO 8601, or a time of day."""
    return re.fullmatch(rf"{_ISO}(?:{_ZONE})?|(?:{_OTHER_DATE})?{_TIME_OF_DAY}", cell) is not None or (
        re.fullmatch(_MINUTES, cell) is not None
    )


def decimal_mark(cells: list[str], given: str | None = None) -> tuple[str | None, str | None]:
    """Return the decimal mark that cells prove, and one that could be read both ways; either may be `None`.

    ``0,005`` and ``1.234,5`` prove a comma, ``0.5`` and ``1,234.5`` a point; ``1,234`` is 1.234 or 1234.
    """
    proven = {mark: False for mark in ".,"}
    doubtful = None
    for cell in cells:
        for mark, other in ((".", ","), (",", ".")):
            if mark in cell and is_number(cell, mark):
                if re.match(grouped_pattern(mark, other), cell):
                    doubtful = cell if mark == "," else doubtful
                else:
                    proven[mark] = True
            elif mark in cell and other in cell and re.match(grouped_pattern(other, mark), cell):
                proven[mark] = True
    marks = [mark for mark in ".," if proven[mark]]
    if given is not None or len(marks) > 1:
        return given or ".", None
    if marks:
        return marks[0], None
    return (None, doubtful) if doubtful else (".", None)


def grouping_of(cells: pa.ChunkedArray, decimal: str) -> str | None:
    """Return the mark that groups the digits of a column of text, every cell of which is a number by it."""
    for mark in GROUPING:
        if mark == decimal:
            continue
        grouped = _matches(cells, grouped_pattern(mark, decimal))
        if pc.any(grouped).as_py() and pc.all(pc.or_(grouped, _matches(cells, plain_pattern(decimal)))).as_py():
            return mark
    return None


def _matches(cells: pa.ChunkedArray, pattern: str) -> pa.ChunkedArray:
    return pc.match_substring_regex(cells, pattern)


def bad_numbers(cells: pa.ChunkedArray, decimal: str = ".", grouping: str | None = None) -> np.ndarray:
    """Return the rows (from 0) of a column of text whose cells are no numbers; empty ones pass."""
    good = _matches(cells, plain_pattern(decimal))
    if grouping is not None:
        good = pc.or_(good, _matches(cells, grouped_pattern(grouping, decimal)))
    return np.flatnonzero(~pc.fill_null(good, True).to_numpy().astype(bool))


def to_numbers(cells: pa.ChunkedArray, decimal: str = ".", grouping: str | None = None) -> pa.ChunkedArray:
    """Return a column of text without `bad_numbers`: int64 where every cell is a whole number, else float64."""
    if grouping is not None:
        cells = pc.replace_substring(cells, grouping, "")
    if decimal != ".":
        cells = pc.replace_substring(cells, decimal, ".")
    cells = pc.replace_substring_regex(cells, r"^\+", "")
    whole = pc.and_(_matches(cells, r"^-?[0-9]+$"), pc.less_equal(pc.utf8_length(cells), _LONGEST_INTEGER))
    return cells.cast(pa.int64() if pc.all(whole).as_py() and not cells.null_count else pa.float64())


def to_dates(cells: pa.ChunkedArray) -> pa.ChunkedArray | None:
    """Return a column of dates in ISO 8601 as time stamps, one of times of day as durations, else `None`.

    Dates of another order count where they are one and the same: then the times of that day are read.

    Args:
        cells: text without blanks around it; all of one kind, with a zone each or none.
    """
    if cells.null_count == len(cells):
        return None
    for pattern, zone in ((_ISO, None), (_ISO + _ZONE, "UTC")):
        if pc.all(_matches(cells, f"^{pattern}$")).as_py():
            plain = pc.replace_substring_regex(pc.replace_substring(cells, ",", "."), r" (Z|[+-][0-9:]+)$", r"\1")
            try:
                return plain.cast(pa.timestamp("ns", zone))
            except pa.ArrowInvalid:
                return None
    for pattern in (_TIME_OF_DAY, _MINUTES, _OTHER_DATE + _TIME_OF_DAY):
        if pc.all(_matches(cells, f"^{pattern}$")).as_py():
            return _since_midnight(pc.extract_regex(cells, f"^{pattern}$"))
    return None


def _since_midnight(parts: pa.ChunkedArray) -> pa.ChunkedArray | None:
    """Return times of one day as durations; where they run over midnight, those of the next day too."""
    fields = {name.name for name in parts.type}

    def part(name: str) -> Any:
        return pc.struct_field(parts, name)

    if "date" in fields and len(pc.unique(part("date"))) > 1:
        return None
    empty = parts.is_null().to_numpy().astype(bool)
    seconds = pc.fill_null(pc.replace_substring(part("s"), ",", "."), "0").cast(pa.decimal128(12, 9))
    nanoseconds = pc.multiply(seconds, pa.scalar(10**9, pa.decimal128(10, 0))).cast(
        pa.decimal128(25, 0), safe=False
    )
    total = nanoseconds.cast(pa.int64()).to_numpy().copy()
    total += 60 * 10**9 * pc.fill_null(part("m"), "0").cast(pa.int64()).to_numpy()
    if "h" in fields:
        hours = pc.fill_null(part("h"), "0").cast(pa.int64()).to_numpy().copy()
        half = pc.fill_null(pc.utf8_upper(part("half")), "").to_numpy().astype(str)
        hours = np.where(half != "", hours % 12 + 12 * (half == "PM"), hours)
        total += 3600 * 10**9 * hours
    turn = (24 if "h" in fields else 1) * 3600 * 10**9
    total += turn * np.concatenate([[0], np.cumsum(np.diff(total) < -turn // 2)])
    return pa.chunked_array([pa.array(total, mask=empty).cast(pa.duration("ns"))])
