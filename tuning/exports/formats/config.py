"""TOML and JSON: the configuration itself, read back equal, with its JSON Schema."""

from __future__ import annotations

import json
from functools import partial
from typing import Any

from tuning.exports.artefact import Artefact, Subject
from tuning.exports.manifest import SHIPPED
from tuning.files.errors import input_error
from tuning.study.base import resolved, to_toml
from tuning.study.foreign import PLUGINS

_USAGE = """```sh
{command}
```

{note}"""
_NOTES = {
    "toml": "Every default is written out.",
    "json": "The same tables as JSON, for other programs; `schema.json` (JSON Schema 2020-12) says what is "
    "allowed. vsajax itself reads TOML.",
}


_COMMANDS = {
    "estimator": "vsajax estimate LOG -c estimator.toml -o estimate.parquet",
    "controller": "vsajax simulate controller.toml -o swing.parquet",
    "designer": "vsajax stiffness designer.toml",
}


def write_config(subject: Subject, form: str) -> Artefact:
    """Return the configuration as "toml" or "json", and its schema."""
    config, noun = subject.deployable.config, subject.deployable.noun
    tables = resolved(config)
    schema = type(config).model_json_schema(mode="validation")
    if PLUGINS in tables:
        schema["properties"][PLUGINS] = {
            "type": "object",
            "description": "What is not vsajax' own, and which version.",
        }
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}
    text = to_toml(tables) if form == "toml" else _json(tables)
    files: dict[str, str | bytes] = {f"{noun}.{form}": text, "schema.json": _json(schema)}
    artefact = Artefact(files, "config", _USAGE.format(command=_COMMANDS[noun], note=_NOTES[form]))
    add_companions(artefact, subject)
    return artefact


def add_companions(artefact: Artefact, subject: Subject) -> None:
    """Add the files that a configuration names.

    Raises:
        InputError: one is called like a file of the export; disks may not tell capitals apart.
    """
    taken = {name.lower() for name in (*artefact.files, *artefact.scripts, *SHIPPED, "manifest.json")}
    for name, contents in subject.deployable.companions.items():
        if name.lower() in taken:
            raise input_error(
                name, "is read by the configuration, but an export writes a file of that name", "rename it"
            )
        artefact.files[name] = contents


def _json(tables: Any) -> str:
    return json.dumps(tables, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


write_toml = partial(write_config, form="toml")
write_json = partial(write_config, form="json")
