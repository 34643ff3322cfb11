"""Nested tables, as TOML files have them: values put at dotted paths, a preset's tables overridden."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

from tuning.errors import input_error

_BARE, _QUOTED = r"[^=.\"']*", r"\"[^\"]*\"|'[^']*'"
_KEY = rf"\s*(?:{_QUOTED}|{_BARE})\s*"
_SETTING = re.compile(rf"(?P<path>{_KEY}(?:\.{_KEY})*)=(?P<value>.*)", re.DOTALL)


def keys_of(path: str) -> list[str]:
    """Return the keys of a dotted path; quotes keep a key together that has dots itself."""
    return [key.strip().strip("\"'") for key in re.findall(rf"(?:^|\.)({_KEY})", path)]


def with_settings(data: dict[str, Any], settings: Sequence[str]) -> dict[str, Any]:
    """Return tables with `a.b=value` settings applied; a key with a dot in it is quoted, as in TOML."""
    for setting in settings:
        found = _SETTING.fullmatch(setting)
        if found is None or not found["path"].strip():
            raise input_error(
                f"--set {setting}",
                "is not of the form a.b=value",
                "e.g. --set estimator.fit.prior_scale=0.1, or --set 'a.\"b.c\"=1' for a key with a dot in it",
            )
        keys, text = keys_of(found["path"]), found["value"]
        try:
            value = tomllib.loads(f"value = {text}")["value"]
        except tomllib.TOMLDecodeError:
            value = text
        try:
            put(data, keys, value)
        except TypeError:
            raise input_error(f"--set {setting}", "leads through a value that is not a table") from None
    return data


def put(tables: dict[str, Any], keys: Sequence[str], value: Any) -> None:
    """Set a value at a path, making tables on the way."""
    *parents, last = keys
    for key in parents:
        tables = tables.setdefault(key, {})
        if not isinstance(tables, dict):
            raise TypeError(key)
    tables[last] = value


def merge(base: dict[str, Any], override: Mapping[str, Any]) -> dict[str, Any]:
    """Return a preset's tables with those of a study in their place."""
    merged = dict(base)
    for key, value in override.items():
        inner = merged.get(key)
        merged[key] = value
        # Another type of spring shares no key with the preset's: it replaces the table.
        if (
            isinstance(inner, dict)
            and isinstance(value, Mapping)
            and value.get("type", inner.get("type")) == inner.get("type")
        ):
            merged[key] = merge(inner, value)
    return merged
