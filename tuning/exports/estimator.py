"""The step program of a configuration's estimator."""

from __future__ import annotations

import re

import equinox as eqx
import jax
import jax.numpy as jnp

from tuning.build import build_estimator
from tuning.exports.c99.naming import RESERVED
from tuning.exports.flatten import flatten
from tuning.exports.program import StepProgram, trace
from tuning.study import Config
from vsajax import Sample
from vsajax.estimators import AbstractEstimator

_SETPOINT = "setpoint_position"


def estimator_program(config: Config) -> StepProgram:
    """Return the step of a configuration's estimator, traced with the signals that it reads.

    Raises:
        Untraceable: it cannot leave Python.
    """
    # The title stands in comments of C and YAML.
    name = " ".join(config.name.replace("*/", "").split())
    title = f"{name}: stiffness estimator of a joint of kind {config.kind}"
    return program_of(build_estimator(config), name=identifier_of(config.name), title=title)


def program_of(estimator: AbstractEstimator, *, name: str, title: str) -> StepProgram:
    """Return the step of an estimator; what it does not read of its numbers is frozen, not a parameter.

    Raises:
        Untraceable: it cannot leave Python.
    """
    sample = sample_of(inputs_of(estimator))

    def traced(parameters: AbstractEstimator) -> StepProgram:
        def whole(leaves: AbstractEstimator) -> AbstractEstimator:
            return eqx.combine(leaves, estimator)

        return trace(
            name,
            title,
            parameters,
            sample,
            lambda leaves, sample: whole(leaves).init(sample),
            lambda leaves, state, sample: whole(leaves).step(state, sample),
        )

    program = traced(eqx.filter(estimator, eqx.is_array))
    read = program.init.used() | program.step.used()
    leaves, structure = jax.tree.flatten(program.parameters.tree)
    return traced(jax.tree.unflatten(structure, [leaf if i in read else None for i, leaf in enumerate(leaves)]))


def inputs_of(estimator: AbstractEstimator) -> tuple[str, ...]:
    """Return the signals that an estimator reads, in the order of a sample.

    A nominal law may read the setpoint without which it could also run, so `needs` does not name it.
    """
    names = estimator.needs | {_SETPOINT}
    traced = jax.make_jaxpr(estimator.step, return_shape=False)
    sample = sample_of(names)
    flat = flatten(traced(jax.eval_shape(estimator.init, sample), sample))
    read = {i - len(flat.inputs) for i in flat.used()}
    present = [name for name in Sample._fields if name == "dt" or name in names]
    reads_setpoint = _SETPOINT in present and present.index(_SETPOINT) - len(present) in read
    return tuple(n for n in Sample._fields if n in estimator.needs or (n == _SETPOINT and reads_setpoint))


def sample_of(names: frozenset[str] | tuple[str, ...]) -> Sample:
    """Return a sample of zeros with some signals."""
    zero = jnp.zeros(())
    return Sample(zero, **{name: zero for name in Sample._fields if name in names})


def identifier_of(name: str) -> str:
    """Return a configuration's name as an identifier of C and FMI that means nothing else there."""
    clean = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_").lower()
    return clean if clean[:1].isalpha() and clean not in RESERVED else f"joint_{clean}".rstrip("_")
