"""The golden recording: what goes into a step, and what jax says comes out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from tuning.exports.arithmetic import uncontracted
from tuning.exports.checks.checking import deviation
from tuning.exports.deployable import Deployable
from tuning.exports.layout import dotted
from tuning.exports.program import Slot, StepProgram
from tuning.files.errors import input_error
from vsajax import Guarded, rollout

Columns = dict[str, np.ndarray]


@dataclass(frozen=True)
class Golden:
    """A recording and its answers.

    Args:
        source: where the signals come from, for people.
        time: [s].
        inputs: every number by its name, `(time,)`.
        outputs: the same.
        rounding: by how much the answers differ where products and sums are fused, relative, by name: what
            rounding alone does to it.
    """

    source: str
    time: np.ndarray
    inputs: Columns
    outputs: Columns
    rounding: dict[str, float]

    @property
    def step(self) -> float | None:
        """The time between samples [s]; None where it varies."""
        count = len(self.time) - 1
        if count < 1:
            return None
        mean = float(f"{(self.time[-1] - self.time[0]) / count:.12g}")
        expected = self.time[0] + mean * np.arange(count + 1)
        return mean if mean > 0.0 and np.abs(self.time - expected).max() <= 1e-9 * mean else None

    @property
    def is_finite(self) -> bool:
        """Whether every input is a number at every sample."""
        return all(np.isfinite(values).all() for values in self.inputs.values())

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
        """Return lowest and highest value of every input, arrays as one: what the artefact was checked on."""
        found: dict[str, list[float]] = {}
        for name, values in self.inputs.items():
            finite = values[np.isfinite(values)]
            low, high = float(finite.min(initial=np.inf)), float(finite.max(initial=-np.inf))
            known = found.get(whole := name.partition("[")[0], [low, high])
            found[whole] = [min(low, known[0]), max(high, known[1])]
        return found


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
    columns, source = deployable.simulate(seconds) if recording is None else deployable.record(recording)
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
        signals: by name, with a leading time axis.
        is_fused: let the compiler fuse products and sums; else plain IEEE arithmetic, as C has it.
    """
    columns = {"dt": np.diff(time, prepend=time[:1]), **signals}
    leaves = [jnp.asarray(columns[name]) for name in program.inputs.names]
    samples = jax.tree.unflatten(jax.tree.structure(program.inputs.tree), leaves)

    @jax.jit
    def run(module: Any, samples: Any, zero: jax.Array) -> Any:
        runs = Guarded(module) if program.guarded else module
        step = runs.step if is_fused else uncontracted(runs.step, zero)
        state = runs.init(jax.tree.map(lambda x: x[0], samples))
        return rollout.scan(step, state, samples)[1]

    answers = run(module, samples, jnp.asarray(0))
    return by_name(program.inputs, samples), by_name(program.outputs, answers)


def assembled(slot: Slot, numbers: Mapping[str, Sequence[float] | np.ndarray]) -> Columns:
    """Return the arrays of a slot, `(time, ...)`, from columns of their numbers; the reverse of `by_name`."""
    arrays = {}
    for path, leaf in slot.places:
        columns = [numbers[dotted((*path, *index))] for index in np.ndindex(*leaf.shape)]
        arrays[dotted(path)] = np.stack(columns, axis=-1).reshape(-1, *leaf.shape)
    return arrays


def by_name(slot: Slot, tree: Any) -> Columns:
    """Return the numbers of a tree over time, each by its name in the slot, e.g. ``stiffness[0][2]``."""
    found = {}
    for (path, leaf), values in zip(slot.places, jax.tree.leaves(tree), strict=True):
        for index in np.ndindex(*leaf.shape):
            found[dotted((*path, *index))] = np.asarray(values)[(slice(None), *index)]
    return found
