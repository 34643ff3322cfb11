"""Generated C in the tests: compiled, and replayed by its own harness."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tuning.exports.arithmetic import uncontracted
from tuning.exports.c99.files import write
from tuning.exports.c99.generate import generate
from tuning.exports.formats.c99 import scalars
from tuning.exports.golden import Golden, by_name
from tuning.exports.program import StepProgram
from tuning.exports.rendering import render
from vsajax import rollout

needs_compiler = pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc, which is not installed")
STRICT = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Werror"]


def answers_of(program: StepProgram, module: Any, step: Any, init: Any, samples: Any) -> Golden:
    """Return what jax answers to samples, in plain arithmetic."""

    def run(module: Any, samples: Any, zero: jax.Array) -> Any:
        state = init(module, jax.tree.map(lambda x: x[0], samples))
        return rollout.scan(uncontracted(lambda s, u: step(module, s, u), zero), state, samples)[1]

    outputs = by_name(program.outputs, jax.jit(run)(module, samples, jnp.asarray(0)))
    inputs = by_name(program.inputs, samples)
    time = np.arange(len(next(iter(inputs.values())))) * 1e-3
    return Golden("a test", time, inputs, outputs, {})


def replay(program: StepProgram, golden: Golden, folder: Path, *options: str) -> dict[str, float]:
    """Return how far the compiled step lies from recorded answers, by output."""
    source = write(program, generate(program), banner="a test")
    values = {"name": program.name, "inputs": scalars(program.inputs), "outputs": scalars(program.outputs)}
    files = {f"{source.name}.h": source.header, f"{source.name}.c": source.source, "golden.csv": golden.csv()}
    files["harness.c"] = render("harness.c", **values)
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    compile_it = ["gcc", *STRICT, "-O1", *options, "-o", "harness", f"{source.name}.c", "harness.c", "-lm"]
    built = subprocess.run(compile_it, cwd=folder, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    ran = subprocess.run(["./harness", "golden.csv"], cwd=folder, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    rows = [line.split() for line in ran.stdout.splitlines()]
    rows = [row for row in rows if row[0] != "bytes"]
    return {row[0]: float("inf") if int(row[3]) else float(row[1]) for row in rows}


def stack(trees: list[Any]) -> Any:
    """Return samples as one tree with a leading time axis."""
    return jax.tree.map(lambda *xs: jnp.stack(xs), *trees)
