"""Units as people write them in a file, by the names that signal maps have for them."""

from __future__ import annotations

import re

_SPELLINGS = {
    "s": r"s|secs?|seconds?",
    "ms": r"ms|msecs?|millis|milliseconds?",
    "us": r"[uµμ]s|usecs?|micros|microseconds?",
    "ns": r"ns|nsecs?|nanos|nanosec|nanoseconds?",
    "rad": r"rads?|radians?",
    "mrad": r"mrads?|milliradians?",
    "deg": r"degs?|degrees?|°",
    "rev": r"revs?|turns?|revolutions?",
    "counts": r"cts|counts?|ticks?|incs?|lsb",
    "N.m": r"n[.*·⋅ _-]?m|newton[- ]?met(?:re|er)s?",
    "mN.m": r"mn[.*·⋅ _-]?m",
    "N.cm": r"n[.*·⋅ _-]?cm",
    "A": r"a|amps?|amperes?",
    "mA": r"ma|milliamps?",
    "V": r"v|volts?",
    "mV": r"mv|millivolts?",
    "N.m/rad": r"n[.*·⋅ _-]?m/rad",
    "mN.m/rad": r"mn[.*·⋅ _-]?m/rad",
    "N.m/deg": r"n[.*·⋅ _-]?m/(?:deg|°)",
}


def unit_named(text: str) -> str | None:
    """Return the unit that a text is, in brackets or without, as signal maps call it, or `None`."""
    bare = text.strip().strip("[](){}<>").strip().lower()
    return next((unit for unit, pattern in _SPELLINGS.items() if re.fullmatch(pattern, bare)), None)
