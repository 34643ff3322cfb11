"""The golden recording: what goes into a step, and what jax says comes out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from tuning.errors import input_error
from tuning.exports.arithmetic import uncontracted
from tuning.exports.checks.checking import deviation
from tuning.exports.deployable import Deployable
from tuning.exports.layout import dotted
from tuning.exports.program import Slot, StepProgram
from tuning.logs.reading import read_recording
from vsajax import Recording, rollout

Columns = dict[str, np.ndarray]


@dataclass(frozen=True)
class Golden:
    """A recording and its answers.

    Args:
        source: where the signals come from, for people.
        time: [s].
        inputs: by name, `(time,)`.
        outputs: by name, `(time,)`.
        rounding: by how much the answers differ where products and sums are fused, relative, by name: what
            rounding alone does to it.
    """

    source: str
    time: np.ndarray
    inputs: Columns
    outputs: Columns
    rounding: dict[str, float]

    def table(self) -> Columns:
        """Return all columns in the order of the file."""
        return {
            "time": self.time,
            **self.inputs,
            **{f"out.{name}": values for name, values in self.outputs.items()},
        }

    def csv(self) -> str:
        """Return the recording as CSV, exact to the last bit."""
        columns = self.table()
        rows = np.stack([np.asarray(values, np.float64) for values in columns.values()], axis=1)
        lines = [",".join(columns), *(",".join(map(repr, row)) for row in rows.tolist())]
        return "\n".join(lines) + "\n"

    def ranges(self) -> dict[str, list[float]]:
        """Return lowest and highest value of every input: what the artefact was checked on."""
        return {name: [float(values.min()), float(values.max())] for name, values in self.inputs.items()}


def make_golden(deployable: Deployable, program: StepProgram, *, seconds: float, recording: Path | None) -> Golden:
    """Return the golden recording: over simulated signals, or over a recording that the user names.

    Args:
        deployable: what is exported.
        program: its step.
        seconds: length of what is simulated [s].
        recording: the user's own recording.

    Raises:
        InputError: the recording lacks a signal, or nothing can be simulated.
    """
    config = deployable.config
    if recording is not None:
        columns, source = dict(read_recording(recording, kind=config.kind).columns), recording.name
    else:
        columns, source = deployable.simulate(seconds)
    names = [name for name in program.inputs.names if name != "dt"]
    if (
        "deflection" in names
        and "deflection" not in columns
        and {"link_position", "motor_position"} <= set(columns)
    ):
        columns["deflection"] = columns["link_position"] - columns["motor_position"]
    lacking = [name for name in names if name not in columns]
    if lacking:
        raise input_error(
            recording or config.name, f"lacks {', '.join(lacking)}", "name a recording with --recording FILE"
        )
    time = np.asarray(columns["time"], np.float64)
    signals = {name: columns[name] for name in names}
    inputs, outputs = answers(deployable.module, program, time, signals)
    _, fused = answers(deployable.module, program, time, signals, is_fused=True)
    rounding = {
        name: deviation(fused[name].astype(float).tolist(), values.astype(float).tolist())
        for name, values in outputs.items()
    }
    return Golden(source, time, inputs, outputs, rounding)


def answers(
    module: Any,
    program: StepProgram,
    time: np.ndarray,
    signals: Mapping[str, np.ndarray],
    *,
    is_fused: bool = False,
) -> tuple[Columns, Columns]:
    """Run the online step, sample after sample; return the inputs and the outputs by name.

    Args:
        module: what has `init` and `step`.
        program: its step.
        time: [s].
        signals: by name.
        is_fused: let the compiler fuse products and sums; else plain IEEE arithmetic, as C has it.
    """
    recording = Recording(jnp.asarray(time), **{name: jnp.asarray(values) for name, values in signals.items()})

    @jax.jit
    def run(module: Any, recording: Recording) -> Any:
        samples = recording.samples()
        step = module.step if is_fused else uncontracted(module.step)
        state = module.init(jax.tree.map(lambda x: x[0], samples))
        return samples, rollout.scan(step, state, samples)[1]

    samples, answers = run(module, recording)
    return by_name(program.inputs, samples), by_name(program.outputs, answers)


def by_name(slot: Slot, tree: Any) -> Columns:
    """Return the numbers of a tree over time, each by its name in the slot, e.g. ``stiffness[0][2]``."""
    found = {}
    for (path, leaf), values in zip(slot.places, jax.tree.leaves(tree), strict=True):
        for index in np.ndindex(*leaf.shape):
            found[dotted((*path, *index))] = np.asarray(values)[(slice(None), *index)]
    return found
