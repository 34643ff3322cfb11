"""The JSON Schema of a kind of file; nothing here imports jax."""

from __future__ import annotations

import json
from pathlib import Path

import click

from tuning.terminal.following import start
from tuning.terminal.options import JSON, QUIET, emit


@click.command(epilog="Example: vsajax schema serial -o serial.schema.json")
@click.argument("kind")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="File; by default it is printed.")
@JSON
@QUIET
def schema(kind: str, output: Path | None, as_json: bool, quiet: bool) -> None:
    """Print or write the JSON Schema of KIND: a kind of study, estimator, or map.

    Editors complete and check a file by it whose first line is #:schema FILE, as `vsajax init` writes it. It knows
    keys, types and ranges; `vsajax check` sees more.
    """
    from tuning.files.errors import input_error
    from tuning.files.whole import write_text
    from tuning.study.schemas import schema_names, schema_of

    if kind not in schema_names():
        raise input_error(f"KIND: got {kind!r}", "has no schema", f"allowed: {', '.join(schema_names())}")
    found = schema_of(kind)
    text = json.dumps(found, indent=2, ensure_ascii=False)
    if output is not None:
        write_text(output, text + "\n")
    following = start(kind) if kind not in {"map", "estimator", "log"} else start()
    if as_json or output is not None:
        result = {"kind": kind, "file": output} if output is not None else found
        emit(result, as_json=as_json, quiet=quiet, text=f"wrote {output}", following=following)
    elif not quiet:
        # JSON has no comments: nothing may follow what another program reads.
        click.echo(text)
