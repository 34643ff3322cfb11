"""The golden recording: what goes into the estimator's step, and what jax says comes out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from tuning.build import build_estimator
from tuning.errors import input_error
from tuning.exports.arithmetic import uncontracted
from tuning.exports.checks.checking import deviation
from tuning.exports.program import Slot, StepProgram
from tuning.logs.reading import read_recording
from tuning.parts.estimators import AlgebraicObserver
from tuning.resources import example_path
from tuning.schema import read_toml
from tuning.single import simulate_recording
from tuning.study import Config, EstimationStudy, parse_study, resolved
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
            rounding alone does to this estimator.
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


def make_golden(config: Config, program: StepProgram, *, seconds: float, recording: Path | None) -> Golden:
    """Return the golden recording of a configuration.

    The signals are those of a study's own joint; of the example joint of its kind for a configuration without one;
    or of a recording that the user names.

    Args:
        config: the configuration.
        program: its step.
        seconds: length of what is simulated [s].
        recording: the user's own recording.

    Raises:
        InputError: the recording lacks a signal, or nothing can be simulated.
    """
    if recording is not None:
        columns, source = dict(read_recording(recording, kind=config.kind).columns), recording.name
    else:
        study = _study_of(config, seconds, program)
        columns, _ = simulate_recording(study, 0)
        source = f"simulated from {study.name!r}, scenario 0"
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
    inputs, outputs = answers(config, program, time, signals)
    _, fused = answers(config, program, time, signals, is_fused=True)
    rounding = {
        name: deviation(fused[name].astype(float).tolist(), values.astype(float).tolist())
        for name, values in outputs.items()
    }
    return Golden(source, time, inputs, outputs, rounding)


def answers(
    config: Config,
    program: StepProgram,
    time: np.ndarray,
    signals: Mapping[str, np.ndarray],
    *,
    is_fused: bool = False,
) -> tuple[Columns, Columns]:
    """Run the online step, sample after sample; return the inputs and the outputs by name.

    Args:
        config: the configuration.
        program: its step.
        time: [s].
        signals: by name.
        is_fused: let the compiler fuse products and sums; else plain IEEE arithmetic, as C has it.
    """
    estimator = build_estimator(config)
    recording = Recording(jnp.asarray(time), **{name: jnp.asarray(values) for name, values in signals.items()})

    @jax.jit
    def run(estimator: Any, recording: Recording) -> Any:
        samples = recording.samples()
        step = estimator.step if is_fused else uncontracted(estimator.step)
        state = estimator.init(jax.tree.map(lambda x: x[0], samples))
        return samples, rollout.scan(step, state, samples)[1]

    samples, answers = run(estimator, recording)
    return by_name(program.inputs, samples), by_name(program.outputs, answers)


def by_name(slot: Slot, tree: Any) -> Columns:
    """Return the arrays of a tree by the names of its slot."""
    return {name: np.asarray(x) for name, x in zip(slot.names, jax.tree.leaves(tree), strict=True)}


def _study_of(config: Config, seconds: float, program: StepProgram) -> EstimationStudy:
    if isinstance(config, EstimationStudy):
        tables = resolved(config)
    else:
        tables = read_toml(example_path(config.kind, "kind"))
        for name in program.inputs.names:
            if name not in {"dt", "deflection"}:
                tables["sensing"].setdefault(name, {})
        sample_time = next((s for s in _sample_times(config)), None)
        if sample_time is not None:
            tables["clock"] = {"sample_time": sample_time}
            for side in [tables["estimator"], *(v for v in tables["estimator"].values() if isinstance(v, dict))]:
                if "sample_time" in side:
                    side["sample_time"] = sample_time
    tables |= {"sweep": {}, "tune": {}, "scorer": {}}
    tables["clock"] = tables["clock"] | {"duration": seconds}
    study = parse_study(tables, "golden recording")
    assert isinstance(study, EstimationStudy)
    return study


def _sample_times(config: Config) -> list[float]:
    parts = [config.estimator, getattr(config.estimator, "side", None), getattr(config.estimator, "other", None)]
    return [part.sample_time for part in parts if isinstance(part, AlgebraicObserver)]
