"""The one description that every generated artefact is written from: a step, traced, with all its numbers named.

`StepProgram` knows no estimator: whatever has `init` and `step` over pytrees (an estimator, a controller) becomes
one. C, FMI, ROS 2, StableHLO and the pages that explain them are written from it, and from nothing else.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from tuning.exports.flatten import Flat, flatten
from tuning.exports.layout import Leaf, Path, Record, describe, dotted, elements
from tuning.exports.ranges import Limits, Range
from vsajax.guard import readings_of
from vsajax.types import Estimate

Places = list[tuple[Path, Leaf]]


@dataclass(frozen=True)
class Slot:
    """Some arrays of a program: all its parameters, or its state, inputs or outputs.

    Args:
        layout: how they are laid out.
        places: where each array lies in it, in jax' order.
        tree: their pytree.
    """

    layout: Record
    places: Places
    tree: Any

    @property
    def names(self) -> list[str]:
        """The arrays by name, e.g. ``fit.covariance[3]``, in jax' order."""
        return [dotted(path) for path, _ in self.places]


@dataclass(frozen=True)
class StepProgram:
    """A recursion that can leave the lab.

    Args:
        name: an identifier.
        title: what it is, for people.
        parameters: the tunable numbers; values are their defaults.
        state: what is remembered; there may be nothing.
        inputs: of one sample.
        outputs: of one sample.
        init: (parameters, inputs) -> state, traced.
        step: (parameters, state, inputs) -> (state, outputs), traced; the bare step of what is guarded.
        guarded: names of the inputs that must be sound, see `vsajax.guard`; whatever runs the step leaves a sample
            out where one is not, and adds the last two outputs, `held` and `skipped`. Empty where nothing is
            guarded.
        limits: of the parameters.
    """

    name: str
    title: str
    parameters: Slot
    state: Slot
    inputs: Slot
    outputs: Slot
    init: Flat
    step: Flat
    limits: Limits
    guarded: tuple[str, ...] = ()

    @property
    def watched(self) -> tuple[str, ...]:
        """The inputs whose jumps leave a sample out too, see `vsajax.jumps`: the readings of what estimates."""
        is_estimator = isinstance(self.outputs.tree, Estimate)
        return tuple(name for name in self.guarded if name != "dt") if is_estimator else ()

    @property
    def defaults(self) -> list[np.ndarray]:
        """The parameters' values, in jax' order."""
        return [np.asarray(value) for value in jax.tree.leaves(self.parameters.tree)]

    def state_bytes(self, real: int = 8) -> int:
        """Return the size of the state where a number has `real` bytes; sums over all samples always have 8."""
        return sum((8 if leaf.is_sum else real) * int(np.prod(leaf.shape)) for _, leaf in self.state.places)


def trace(
    name: str,
    title: str,
    module: Any,
    inputs: Any,
    init: Callable[[Any, Any], Any],
    step: Callable[[Any, Any, Any], Any],
    *,
    limits: Callable[[list[Path]], Limits] | None = None,
) -> StepProgram:
    """Return the program of a module.

    Args:
        name: an identifier.
        title: what it is, for people.
        module: a pytree whose array leaves are the parameters.
        inputs: a sample, of any values.
        init: (module, inputs) -> state.
        step: (module, state, inputs) -> (state, outputs).
        limits: of the parameters at some paths; by default they may be any finite number.

    Raises:
        Untraceable: a part of the step cannot leave Python.
    """
    start, first = jax.make_jaxpr(init, return_shape=True)(module, inputs)
    whole, (_, answer) = jax.make_jaxpr(step, return_shape=True)(module, first, inputs)
    guarded = ()
    if hasattr(answer, "held"):
        marks = jax.ShapeDtypeStruct((), bool), jax.ShapeDtypeStruct((), np.int32)
        answer = answer._replace(held=marks[0], skipped=marks[1])
        guarded = _readings(inputs)
    slots = [slot_of(module), slot_of(first, is_optional=True), slot_of(inputs), slot_of(answer)]
    paths = [path for path, _ in slots[0].places]
    known = Limits((Range(),) * len(paths)) if limits is None else limits(paths)
    return StepProgram(
        name, title, *slots, init=flatten(start), step=flatten(whole), limits=known, guarded=guarded
    )


def program_of(
    module: Any, sample: Any, *, name: str, title: str, limits: Callable[[list[Path]], Limits] | None = None
) -> StepProgram:
    """Return the step of a module; what it does not read of its numbers is frozen, not a parameter.

    Raises:
        Untraceable: it cannot leave Python.
    """

    def traced(parameters: Any) -> StepProgram:
        def whole(leaves: Any) -> Any:
            return eqx.combine(leaves, module)

        return trace(
            name,
            title,
            parameters,
            sample,
            lambda leaves, sample: whole(leaves).init(sample),
            lambda leaves, state, sample: whole(leaves).step(state, sample),
            limits=limits,
        )

    program = traced(eqx.filter(module, eqx.is_array))
    read = program.init.used() | program.step.used()
    leaves, structure = jax.tree.flatten(program.parameters.tree)
    return traced(jax.tree.unflatten(structure, [leaf if i in read else None for i, leaf in enumerate(leaves)]))


def _readings(inputs: Any) -> tuple[str, ...]:
    """Return the names of the inputs that must be sound."""
    # Arrays of their own, since two inputs may be one array, and types are checked where the tests say so.
    apart = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), inputs)
    read = {id(x) for x in jax.tree.leaves(readings_of(apart))}
    return tuple(
        name for name, x in zip(slot_of(inputs).names, jax.tree.leaves(apart), strict=True) if id(x) in read
    )


def slot_of(tree: Any, *, is_optional: bool = False) -> Slot:
    """Return a slot of a tree of arrays, or of their shapes."""
    layout = describe(tree)
    if layout is None and is_optional:
        return Slot(Record("nothing", "", {}), [], tree)
    assert isinstance(layout, Record), "parameters, state, inputs and outputs are named"
    return Slot(layout, elements(tree, layout), tree)
