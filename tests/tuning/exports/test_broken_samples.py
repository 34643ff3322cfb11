"""A sample that is no number, or absurd, never enters a state that a robot runs on: in C and in JAX alike."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests.tuning.exports.native import needs_compiler, replay
from tuning.exports.configs import load_exportable
from tuning.exports.deployables import deployable_of
from tuning.exports.golden import answers, assembled, make_golden
from tuning.resources import CONFIGS

WINDOW = ("estimator.side.window=0.05", "estimator.side.longest_window=0.05", "sweep={}", "tune={}")
EXPORTS = {
    "serial": ("studies/serial.toml", ()),
    "sensor": ("tuned/sea_sensor.toml", ()),
    "algebraic pair": ("studies/antagonistic.toml", WINDOW),
    "controller": ("studies/damping.toml", ()),
    "arm": ("studies/arm.toml", ()),
}
FAULTS = (np.nan, np.inf, -np.inf, 1e30, -1e30)
SECONDS = 2.6


@needs_compiler
@pytest.mark.equivalence
@pytest.mark.parametrize("name", EXPORTS)
def test_a_hundred_broken_samples_leave_no_trace_of_themselves(name, tmp_path):
    file, settings = EXPORTS[name]
    deployable = deployable_of(load_exportable(CONFIGS / file, settings=settings), str(CONFIGS / file))
    program = deployable.program()
    golden = make_golden(deployable, program, seconds=SECONDS, recording=None)
    rng = np.random.default_rng(1)
    whole = {signal: np.array(values) for signal, values in golden.inputs.items()}
    watched = [signal for signal in whole if signal.partition("[")[0] in program.guarded]
    # The very first sample is one of them, and nothing breaks in the last two seconds.
    last = int(np.searchsorted(golden.time, golden.time[-1] - 2.0))
    places = {0, *rng.integers(0, last, 100).tolist()}
    broken = {signal: values.copy() for signal, values in whole.items()}
    for place in places:
        broken[rng.choice(watched)][place] = rng.choice(FAULTS)
    inputs, outputs = answers(deployable.module, program, golden.time, assembled(program.inputs, broken))
    assert np.array_equal(outputs["held"], [k in places for k in range(len(golden.time))])
    assert outputs["skipped"][-1] == len(places)
    assert not any(outputs[known][sorted(places)].any() for known in outputs if known.endswith("known"))
    settled = slice(last, None)
    for output, values in outputs.items():
        unbroken = np.isfinite(golden.outputs[output][settled].astype(float))
        assert np.isfinite(values[settled].astype(float)[unbroken]).all(), output
    faulty = dataclasses.replace(golden, inputs=inputs, outputs=outputs)
    worst = replay(program, faulty, tmp_path, "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    assert max(worst.values()) < 1e-9, worst
