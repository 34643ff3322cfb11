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
    from tuning.schema import validate
    from tuning.study import Config, Study, parse_study, resolved, study_hash

    found = tables()
    is_study = "joint" in found
    config = parse_study(found, FILE.name) if is_study else validate(Config, found, FILE.name)
    assert isinstance(config, Study) == is_study
    equal = resolved(config) == found and study_hash(config) == MANIFEST["study_hash"]
    return Result("read back", "passed" if equal else "failed", "equal" if equal else "what was read back DIFFERS")


def replay() -> Result:
    """Run the estimator, as it is read from the file, over the golden recording."""
    from tuning.runtime import start_jax

    start_jax()
    import numpy as np

    from tuning.exports.estimator import estimator_program
    from tuning.exports.golden import answers
    from tuning.schema import validate
    from tuning.study import Config, parse_study

    found = tables()
    config = parse_study(found, FILE.name) if "joint" in found else validate(Config, found, FILE.name)
    assert isinstance(config, Config)
    golden = read_golden()
    program = estimator_program(config)
    signals = {name: np.asarray(values) for name, values in golden.inputs.items() if name != "dt"}
    _, got = answers(config, program, np.asarray(golden.time), signals)
    return compare(
        "replay", "the step of jax", {k: v.astype(float).tolist() for k, v in got.items()}, golden.outputs
    )


if __name__ == "__main__":
    run_checks(
        [schema, read_back] if "--quick" in sys.argv else [schema, read_back, replay], needs="'vsajax[export]'"
    )
