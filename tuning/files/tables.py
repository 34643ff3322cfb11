"""Nested tables, as TOML files have them: values put at dotted paths, a preset's tables overridden."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from tuning.files.errors import InputError, input_error

_BARE, _QUOTED = r"[^=.\"']*", r"\"[^\"]*\"|'[^']*'"
_KEY = rf"\s*(?:{_QUOTED}|{_BARE})\s*"
_SETTING = re.compile(rf"(?P<path>{_KEY}(?:\.{_KEY})*)=(?P<value>.*)", re.DOTALL)
_SHOWN = 120
"""Letters of a setting that an error repeats."""
DEEPEST = 48
"""Tables and lists in one another that a file may have: no study has ten."""


def parse_toml(text: str, place: object, fix: str) -> dict[str, Any]:
    """Return the tables of TOML text.

    Args:
        text: the text.
        place: its source, for errors.
        fix: the way out where it is not TOML.

    Raises:
        InputError: it is not TOML (with line and column), or `require_sane` refuses it.
    """
    try:
        tables = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise input_error(place, f"is not valid TOML: {error}", fix) from None
    except RecursionError:
        raise _too_deep(place) from None
    except ValueError as error:
        # Python reads no whole number of more than 4300 digits, whatever the format allows.
        raise input_error(
            place, f"holds a number that cannot be read: {error}", "write it in fewer digits"
        ) from None
    require_sane(tables, place)
    return tables


def require_sane(tables: Mapping[str, Any], place: object) -> None:
    """Refuse tables nested deeper than `DEEPEST`, and whole numbers beyond TOML's 64 bits.

    Whatever reads them would fail: a recursion, or a conversion to a float or to text.
    """
    level: list[tuple[str, Any]] = [("", tables)]
    for _ in range(DEEPEST):
        level = [inner for path, value in level for inner in _inside(path, value)]
        for path, value in level:
            if isinstance(value, int) and abs(value) >= 2**64:
                digits = int(value.bit_length() / math.log2(10)) + 1
                problem = f"got a whole number of {digits} digits or so; TOML's end at 2**63 = 9.2e18"
                raise input_error(f"{place}: {path}", problem, "write a smaller one, or a float, e.g. 1e20")
        level = [(path, value) for path, value in level if isinstance(value, dict | list)]
        if not level:
            return
    raise _too_deep(place)


def _inside(path: str, value: dict[str, Any] | list[Any]) -> Iterator[tuple[str, Any]]:
    items = value.items() if isinstance(value, dict) else enumerate(value)
    return ((f"{path}.{key}" if path else str(key), inner) for key, inner in items)


def _too_deep(place: object) -> InputError:
    return input_error(place, f"nests more than {DEEPEST} tables or lists in one another", "flatten it")


def keys_of(path: str) -> list[str]:
    """Return the keys of a dotted path; quotes keep a key together that has dots itself."""
    return [key.strip().strip("\"'") for key in re.findall(rf"(?:^|\.)({_KEY})", path)]


def with_settings(data: dict[str, Any], settings: Sequence[str]) -> dict[str, Any]:
    """Return tables with `a.b=value` settings applied; a key with a dot in it is quoted, as in TOML."""
    for setting in settings:
        where = f"--set {setting if len(setting) <= _SHOWN else f'{setting[:_SHOWN]} …'}"
        found = _SETTING.fullmatch(setting)
        if found is None or not found["path"].strip():
            raise input_error(
                where,
                "is not of the form a.b=value",
                "e.g. --set estimator.fit.prior_scale=0.1, or --set 'a.\"b.c\"=1' for a key with a dot in it",
            )
        value = _value_of(found["value"], where)
        try:
            put(data, keys_of(found["path"]), value)
        except TypeError:
            raise input_error(where, "leads through a value that is not a table") from None
        require_sane(data, where)
    return data


def _value_of(text: str, place: str) -> Any:
    """Return a setting's value: as TOML has it, or the text itself where it is none."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text
    except (RecursionError, ValueError):
        return parse_toml(f"value = {text}", place, "")["value"]  # which says it in words


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
