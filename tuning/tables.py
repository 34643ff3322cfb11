"""Nested tables, as TOML files have them: values put at dotted paths, a preset's tables overridden."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

from tuning.errors import input_error


def with_settings(data: dict[str, Any], settings: Sequence[str]) -> dict[str, Any]:
    """Return tables with `a.b=value` settings applied."""
    for setting in settings:
        path, separator, text = setting.partition("=")
        if not separator or not path.strip():
            raise input_error(
                f"--set {setting}", "is not of the form a.b=value", "e.g. --set estimator.fit.prior_scale=0.1"
            )
        try:
            value = tomllib.loads(f"value = {text}")["value"]
        except tomllib.TOMLDecodeError:
            value = text
        try:
            put(data, path.strip().split("."), value)
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
