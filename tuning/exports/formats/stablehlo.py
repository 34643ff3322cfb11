"""StableHLO: jax' own export of the step and of the batched scan, which any process with jax can call."""

from __future__ import annotations

import json
from typing import Any

import jax
import jax.numpy as jnp
from jax import export
from jax.extend import core as jex

from tuning.exports.artefact import Artefact, Subject
from tuning.exports.flatten import Flat
from tuning.exports.program import Slot, StepProgram
from vsajax import rollout

_PLATFORMS = ("cpu", "cuda")
_USAGE = """```python
import jax
from jax import export
from jax.extend import core as jex

jax.config.update("jax_enable_x64", True)


def load(name):
    return export.deserialize(bytearray(open(f"{{name}}.stablehlo", "rb").read())).call


init, step, scan = load("init"), load("step"), load("scan")
state = init(parameters, sample)  # dictionaries of arrays, by the names below
state, answer = step(parameters, state, sample)
answers = scan(parameters, recordings)  # (lane, time) each in, (lane, time) each out; any number of both
```

`parameters.json` has the parameters. Nothing of vsajax is needed. Lowered for {platforms}. `step.mlir` is the step
as text, for other compilers of StableHLO."""


def write_stablehlo(subject: Subject) -> Artefact:
    """Return the serialised functions `init`, `step` and `scan`, over dictionaries of arrays."""
    program = subject.program
    functions = Functions(program)
    parameters = _shapes(program.parameters)
    state, sample = _shapes(program.state), _shapes(program.inputs)
    lanes, time = export.symbolic_shape("lanes, time")
    recording = {name: jax.ShapeDtypeStruct((lanes, time, *x.shape), x.dtype) for name, x in sample.items()}
    exported = {
        "init": _export(functions.init, parameters, sample),
        "step": _export(functions.step, parameters, state, sample),
        "scan": _export(functions.scan, parameters, recording),
    }
    files: dict[str, str | bytes] = {f"{name}.stablehlo": bytes(one.serialize()) for name, one in exported.items()}
    files["step.mlir"] = exported["step"].mlir_module()
    values = dict(zip(program.parameters.names, (value.tolist() for value in program.defaults), strict=True))
    files["parameters.json"] = json.dumps(values, indent=2) + "\n"
    usage = _USAGE.format(platforms=" and ".join(_PLATFORMS))
    versions = {"calling_convention_version": exported["step"].calling_convention_version}
    return Artefact(files, "stablehlo", usage, {"stablehlo": versions | {"platforms": list(_PLATFORMS)}})


class Functions:
    """A program as functions of dictionaries of arrays.

    Args:
        program: the program.
    """

    def __init__(self, program: StepProgram):
        self.program = program

    def init(self, parameters: dict[str, Any], sample: dict[str, Any]) -> dict[str, Any]:
        """Return the state before the first sample."""
        p = self.program
        return _named(p.state, _run(p.init, _listed(p.parameters, parameters) + _listed(p.inputs, sample)))

    def step(
        self, parameters: dict[str, Any], state: dict[str, Any], sample: dict[str, Any]
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the next state and the outputs."""
        p = self.program
        given = _listed(p.parameters, parameters) + _listed(p.state, state) + _listed(p.inputs, sample)
        results = _run(p.step, given)
        return _named(p.state, results[: len(p.state.places)]), _named(p.outputs, results[len(p.state.places) :])

    def scan(self, parameters: dict[str, Any], recordings: dict[str, Any]) -> dict[str, Any]:
        """Return the outputs over `(lane, time)` recordings."""

        def lane(recording: dict[str, Any]) -> dict[str, Any]:
            state = self.init(parameters, {name: values[0] for name, values in recording.items()})
            samples = next(iter(recording.values())).shape[0]
            return rollout.scan(
                lambda s, sample: self.step(parameters, s, sample), state, recording, segment=samples
            )[1]

        return jax.vmap(lane)(recordings)


def _run(flat: Flat, given: list[Any]) -> list[Any]:
    """Evaluate a traced function."""
    return jex.jaxpr_as_fun(flat.closed)(*given)


def _export(function: Any, *arguments: Any) -> export.Exported:
    return export.export(jax.jit(function), platforms=_PLATFORMS)(*arguments)


def _shapes(slot: Slot) -> dict[str, jax.ShapeDtypeStruct]:
    leaves = jax.tree.leaves(slot.tree)
    return {name: jax.ShapeDtypeStruct(x.shape, x.dtype) for name, x in zip(slot.names, leaves, strict=True)}


def _listed(slot: Slot, values: dict[str, Any]) -> list[Any]:
    return [jnp.asarray(values[name]) for name in slot.names]


def _named(slot: Slot, values: list[Any]) -> dict[str, Any]:
    return dict(zip(slot.names, values, strict=True))
