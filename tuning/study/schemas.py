"""JSON Schemas of the files that the lab reads, for editors and other programs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tuning.files.kinds import CONFIG, SIGNAL_MAP, kind_of
from tuning.files.shipped import shipped_files
from tuning.study.base import Base
from tuning.study.kinds import all_kinds
from tuning.study.refs import Ref

DIALECT = "https://json-schema.org/draft/2020-12/schema"
_OTHERS = {
    "estimator": Ref("tuning.study.base:Config"),
    "map": Ref("tuning.logs.signal_map:SignalMap"),
}
"""What is no study: an estimator alone, and the signal map of a log."""


def schema_names() -> list[str]:
    """Return the names of what has a schema."""
    return [*sorted(kind.name for kind in all_kinds()), *_OTHERS]


def schema_of(name: str) -> dict[str, Any]:
    """Return the JSON Schema of a kind of study, of "estimator", or of "map".

    It knows keys, types and the ranges of single numbers. What it refuses `vsajax check` refuses too, which beyond
    that sees what no single number can: signals that are missing, orders, paths that lead nowhere.

    Raises:
        KeyError: there is none of that name.
    """
    kinds = {kind.name: kind.tables for kind in all_kinds()}
    tables = (kinds | _OTHERS)[name].load()
    schema = tables.model_json_schema(mode="validation")
    if issubclass(tables, Base):
        for table, folder in tables.presets.items():
            schema["properties"][table] = _with_preset(schema, table, folder)
    return {"$schema": DIALECT, **schema, "title": f"vsajax {name}"}


def _with_preset(schema: Mapping[str, Any], table: str, folder: str) -> dict[str, Any]:
    """Return the schema of a table that is written out, or the name of a shipped one with some keys of its own."""
    whole = schema["properties"][table]
    keys = schema["$defs"][whole["$ref"].rpartition("/")[2]]["properties"] if "$ref" in whole else {}
    names = [name.partition("/")[2] for name in shipped_files() if name.startswith(f"{folder}/")]
    preset = {"description": f"A shipped file of {folder}; the other keys replace its own.", "enum": names}
    short = {
        "type": "object",
        "required": ["preset"],
        "properties": {"preset": preset, **dict.fromkeys(keys, True)},
        "additionalProperties": False,
    }
    return {"anyOf": [whole, short]}


def name_in(tables: Mapping[str, Any]) -> str | None:
    """Return the name of the schema that a file's tables follow; `None` where there is none."""
    file = kind_of(tables)
    if file is CONFIG:
        return "estimator"
    if file is SIGNAL_MAP:
        return "map"
    return next((kind.name for kind in all_kinds() if kind.file is file and kind.is_of(tables)), None)


def schema_file(name: str) -> Path:
    """Return what the file of a schema is called, beside the files that follow it."""
    return Path(f"{name}.schema.json")
