"""Reads the configuration back: against its schema, its hash, and the golden recording. Needs vsajax."""

import json
import sys
import tomllib

from checking import HERE, Result, compare, read_golden, run_checks  # pyright: ignore[reportMissingImports]

MANIFEST = json.loads((HERE / "manifest.json").read_text(encoding="utf-8"))
FILE = HERE / MANIFEST["files"][0]


def tables() -> dict:
    """Return the configuration's tables."""
    text = FILE.read_text(encoding="utf-8")
    return tomllib.loads(text) if FILE.suffix == ".toml" else json.loads(text)


def schema() -> Result:
    """Validate against the schema."""
    import jsonschema

    described = json.loads((HERE / "schema.json").read_text(encoding="utf-8"))
    validator = jsonschema.Draft202012Validator(described)
    problems = [f"{'.'.join(map(str, e.path))}: {e.message[:120]}" for e in validator.iter_errors(tables())]
    return Result(
        "schema", "failed" if problems else "passed", "; ".join(problems[:3]) or "valid against schema.json"
    )


def read_back() -> Result:
    """See that what is read is what was exported."""
    from tuning.study.base import FOLDER, resolved, study_hash
    from tuning.study.kinds import exported_files
    from tuning.study.loading import parse

    found = tables()
    config = parse(found, str(FILE), *exported_files())
    read = resolved(config)
    # Where the files lie that it names is added as it is read: here, beside it.
    read["provenance"].pop(FOLDER, None)
    equal = read == found and study_hash(config) == MANIFEST["study_hash"]
    return Result("read back", "passed" if equal else "failed", "equal" if equal else "what was read back DIFFERS")


def replay() -> Result:
    """Run the step, as it is read from the file, over the golden recording."""
    from tuning.runs.machine import start_jax

    start_jax()
    import numpy as np

    from tuning.exports.deployable import deployable_of
    from tuning.exports.golden import answers, assembled
    from tuning.study.kinds import exported_files
    from tuning.study.loading import parse

    deployable = deployable_of(parse(tables(), str(FILE), *exported_files()), str(FILE))
    golden = read_golden()
    program = deployable.program()
    signals = assembled(program.inputs, golden.inputs)
    _, got = answers(deployable.module, program, np.asarray(golden.time), signals)
    return compare(
        "replay", "the step of jax", {k: v.astype(float).tolist() for k, v in got.items()}, golden.outputs
    )


if __name__ == "__main__":
    run_checks([schema, read_back] if "--quick" in sys.argv else [schema, read_back, replay])
