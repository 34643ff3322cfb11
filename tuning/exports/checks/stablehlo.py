"""Loads the functions in this process, which has jax and nothing of vsajax, and replays the golden recording.

The recording was made in plain IEEE arithmetic; where a processor can fuse products and sums, XLA is told not to.
"""

import importlib
import json
import os
import platform
import sys
from typing import Any

from checking import HERE, Result, Unreadable, as_arrays, as_columns, compare, read_golden, run_checks  # pyright: ignore[reportMissingImports]

MANIFEST = json.loads((HERE / "manifest.json").read_text(encoding="utf-8"))

if platform.machine().lower() in {"x86_64", "amd64"}:
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} --xla_cpu_max_isa=AVX"


def load(name: str) -> Any:
    """Return a function of the export.

    Raises:
        Unreadable: jax is of another version than what can read it.
    """
    import flatbuffers  # noqa: F401  # jax reads with it, and does not install it
    import jax

    jax.config.update("jax_enable_x64", True)
    written = bytearray((HERE / f"{name}.stablehlo").read_bytes())
    try:
        return importlib.import_module("jax.export").deserialize(written).call
    except Exception as error:
        wrote = MANIFEST["stablehlo"]["jax"]
        raise Unreadable(
            f"jax {jax.__version__} cannot read what jax {wrote} wrote ({error}): that version reads it, and "
            f"later ones for six months; pip install jax=={wrote} flatbuffers"
        ) from None


def given() -> Any:
    """Return parameters and samples as arrays."""
    import jax.numpy as jnp

    values = json.loads((HERE / "parameters.json").read_text(encoding="utf-8"))
    golden = read_golden()
    inputs = MANIFEST["inputs"]
    return (
        {name: jnp.asarray(value, float) for name, value in values.items()},
        {name: jnp.asarray(array) for name, array in as_arrays(golden.inputs, inputs).items()},
        golden,
    )


def step() -> Result:
    """Run the step, sample after sample."""
    import jax

    initialise, advance = load("init"), load("step")
    parameters, samples, golden = given()

    @jax.jit
    def run(parameters: Any, samples: Any) -> Any:
        def one(state: Any, sample: Any) -> tuple[Any, Any]:
            return advance(parameters, state, sample)

        state: Any = initialise(parameters, {name: values[0] for name, values in samples.items()})
        return jax.lax.scan(one, state, samples)[1]

    return compare("step", "init and step", as_columns(run(parameters, samples)), golden.outputs)


def scan() -> Result:
    """Run the batched scan over two lanes."""
    import jax.numpy as jnp

    parameters, samples, golden = given()
    answers: Any = load("scan")(parameters, {name: jnp.stack([v, v]) for name, v in samples.items()})
    second = as_columns({name: values[1] for name, values in answers.items()})
    return compare("scan", "two lanes", second, golden.outputs)


if __name__ == "__main__":
    run_checks([step] if "--quick" in sys.argv else [step, scan])
