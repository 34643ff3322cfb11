"""TOML and JSON: the configuration itself, read back equal, with its JSON Schema."""

from __future__ import annotations

import json
from functools import partial
from typing import Any

from tuning.exports.artefact import Artefact, Subject
from tuning.study import resolved, to_toml

_USAGE = """```sh
vsajax estimate LOG -c estimator.{format} -o estimate.parquet
```

{note}"""
_NOTES = {
    "toml": "Every default is written out.",
    "json": "The same tables as JSON, for other programs; `schema.json` (JSON Schema 2020-12) says what is "
    "allowed. vsajax itself reads TOML.",
}


def write_config(subject: Subject, form: str) -> Artefact:
    """Return the configuration as "toml" or "json", and its schema."""
    tables = resolved(subject.config)
    schema = type(subject.config).model_json_schema(mode="validation")
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}
    text = to_toml(tables) if form == "toml" else _json(tables)
    files: dict[str, str | bytes] = {f"estimator.{form}": text, "schema.json": _json(schema)}
    return Artefact(files, "config", _USAGE.format(format="toml", note=_NOTES[form]))


def _json(tables: Any) -> str:
    return json.dumps(tables, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


write_toml = partial(write_config, form="toml")
write_json = partial(write_config, form="json")
