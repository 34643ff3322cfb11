"""StableHLO: jax' own export of the step and of the batched scan, which any process with jax can call."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jax import export
from jax.extend import core as jex

from tuning.exports.artefact import Artefact, Subject
from tuning.exports.flatten import Flat
from tuning.exports.program import Slot, StepProgram, slot_of
from vsajax import Guarded, rollout

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

`parameters.json` has the parameters. Nothing of vsajax is needed, but jax and flatbuffers are
(`pip install jax=={jax} flatbuffers`). Written by jax {jax}: that version reads it, later ones do for six months,
as jax promises; older ones may not. Lowered for {platforms}. `step.mlir` is the step as text,
for other compilers of StableHLO."""


def write_stablehlo(subject: Subject) -> Artefact:
    """Return the serialised functions `init`, `step` and `scan`, over dictionaries of arrays."""
    program = subject.program
    functions = Functions(program)
    parameters = _shapes(program.parameters)
    state, sample = _shapes(functions.state), _shapes(program.inputs)
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
    usage = _USAGE.format(platforms=" and ".join(_PLATFORMS), jax=jax.__version__)
    about = {
        "jax": jax.__version__,
        "calling_convention_version": exported["step"].calling_convention_version,
        "platforms": list(_PLATFORMS),
    }
    return Artefact(files, "stablehlo", usage, {"stablehlo": about})


@dataclass(frozen=True)
class _Traced:
    """A program's step over named tuples, as `vsajax.guard` takes it.

    Args:
        program: the program.
        parameters: its parameters, in jax' order.
    """

    program: StepProgram
    parameters: list[Any]

    def init(self, sample: Any) -> Any:
        """Return the state before the first sample."""
        p = self.program
        return jax.tree.unflatten(
            jax.tree.structure(p.state.tree), _run(p.init, [*self.parameters, *jax.tree.leaves(sample)])
        )

    def step(self, state: Any, sample: Any) -> tuple[Any, Any]:
        """Return the next state and the outputs."""
        p = self.program
        results = _run(p.step, [*self.parameters, *jax.tree.leaves((state, sample))])
        count = len(p.state.places)
        answer = p.outputs.tree
        bare = answer._replace(held=None, skipped=None) if p.guarded else answer
        return (
            jax.tree.unflatten(jax.tree.structure(p.state.tree), results[:count]),
            jax.tree.unflatten(jax.tree.structure(bare), results[count:]),
        )


class Functions:
    """A program as functions of dictionaries of arrays.

    Args:
        program: the program.
    """

    def __init__(self, program: StepProgram):
        self.program = program
        self.state = program.state
        if program.guarded:
            parameters = jax.tree.leaves(program.parameters.tree)
            module = self._module(dict(zip(program.parameters.names, parameters, strict=True)))
            self.state = slot_of(jax.eval_shape(module.init, program.inputs.tree))

    def init(self, parameters: dict[str, Any], sample: dict[str, Any]) -> dict[str, Any]:
        """Return the state before the first sample."""
        return _named(self.state, self._module(parameters).init(_assembled(self.program.inputs, sample)))

    def step(
        self, parameters: dict[str, Any], state: dict[str, Any], sample: dict[str, Any]
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the next state and the outputs."""
        given = _assembled(self.state, state), _assembled(self.program.inputs, sample)
        moved, answer = self._module(parameters).step(*given)
        return _named(self.state, moved), _named(self.program.outputs, answer)

    def scan(self, parameters: dict[str, Any], recordings: dict[str, Any]) -> dict[str, Any]:
        """Return the outputs over `(lane, time)` recordings."""

        def lane(recording: dict[str, Any]) -> dict[str, Any]:
            state = self.init(parameters, {name: values[0] for name, values in recording.items()})
            samples = next(iter(recording.values())).shape[0]
            return rollout.scan(
                lambda s, sample: self.step(parameters, s, sample), state, recording, segment=samples
            )[1]

        return jax.vmap(lane)(recordings)

    def _module(self, parameters: dict[str, Any]) -> Any:
        traced = _Traced(self.program, [jnp.asarray(parameters[name]) for name in self.program.parameters.names])
        return Guarded(traced) if self.program.guarded else traced


def _run(flat: Flat, given: list[Any]) -> list[Any]:
    """Evaluate a traced function."""
    return jex.jaxpr_as_fun(flat.closed)(*given)


def _export(function: Any, *arguments: Any) -> export.Exported:
    return export.export(jax.jit(function), platforms=_PLATFORMS)(*arguments)


def _shapes(slot: Slot) -> dict[str, jax.ShapeDtypeStruct]:
    leaves = jax.tree.leaves(slot.tree)
    return {name: jax.ShapeDtypeStruct(x.shape, x.dtype) for name, x in zip(slot.names, leaves, strict=True)}


def _assembled(slot: Slot, values: dict[str, Any]) -> Any:
    leaves = [jnp.asarray(values[name]) for name in slot.names]
    return jax.tree.unflatten(jax.tree.structure(slot.tree), leaves)


def _named(slot: Slot, tree: Any) -> dict[str, Any]:
    return dict(zip(slot.names, jax.tree.leaves(tree), strict=True))
