"""A sample that is no number, or absurd, never enters a state that a robot runs on: in C and in JAX alike."""

from __future__ import annotations

import jax
import numpy as np
import pytest

from tests.tuning.exports.native import needs_compiler, replay
from tuning.exports.checks.checking import deviation
from tuning.exports.deployable import load_deployable
from tuning.exports.golden import Golden, answers, assembled, by_name
from tuning.files.shipped import CONFIGS

WINDOW = ("estimator.side.window=0.05", "estimator.side.longest_window=0.05", "sweep={}", "tune={}")
EXPORTS = {
    "serial": ("studies/serial.toml", ()),
    "sensor": ("tuned/sea_sensor.toml", ()),
    "algebraic pair": ("studies/antagonistic.toml", WINDOW),
    "controller": ("studies/damping.toml", ()),
    "arm": ("studies/arm.toml", ()),
}
FAULTS = (np.nan, np.inf, -np.inf, 1e30, -1e30)
JUMPS = (1e2, -1e4, 1e6, -1e8)
"""Sound as numbers, but out of place: of what estimates."""
SECONDS = 2.6


@needs_compiler
@pytest.mark.equivalence
@pytest.mark.parametrize(
    "name",
    [one if one in {"sensor", "controller"} else pytest.param(one, marks=pytest.mark.slow) for one in EXPORTS],
)
def test_a_hundred_broken_samples_leave_no_trace_of_themselves(name, tmp_path):
    file, settings = EXPORTS[name]
    deployable = load_deployable(CONFIGS / file, settings=settings)
    program = deployable.program()
    columns, _ = deployable.simulate(SECONDS)
    if "deflection" in program.inputs.names:
        columns["deflection"] = columns["link_position"] - columns["motor_position"]
    time = columns["time"]
    whole = by_name(
        program.inputs,
        jax.tree.unflatten(
            jax.tree.structure(program.inputs.tree),
            [
                np.diff(time, prepend=time[:1]) if signal == "dt" else columns[signal]
                for signal in program.inputs.names
            ],
        ),
    )
    rng = np.random.default_rng(1)
    watched = [signal for signal in whole if signal.partition("[")[0] in program.guarded]
    # The very first sample is one of them, and nothing breaks in the last two seconds.
    last = int(np.searchsorted(time, time[-1] - 2.0))
    places = {0, *rng.integers(0, last, 100).tolist()}
    broken = {signal: values.copy() for signal, values in whole.items()}
    for place in places:
        # What nothing sound came before is no jump, nor is what stays; and a long time is none of a reading.
        signal = rng.choice(watched)
        jumps = JUMPS if signal in program.watched and place > 50 and place % 4 == 0 else ()
        broken[signal][place] = rng.choice(FAULTS + jumps)
    given = assembled(program.inputs, broken)
    inputs, outputs = answers(deployable.module, program, time, given)
    assert np.flatnonzero(outputs["held"]).tolist() == sorted(places)
    assert outputs["skipped"][-1] == len(places)
    assert not any(outputs[known][sorted(places)].any() for known in outputs if known.endswith("known"))
    # The last cycles of an arm's path ask for what its design refuses with NaN and a status.
    settled = slice(last, -5)
    for output, values in outputs.items():
        assert np.isfinite(values[settled].astype(float)).all(), output
    faulty = Golden("a test", time, inputs, outputs, {})
    worst = replay(program, faulty, tmp_path, "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    if max(worst.values()) > 1e-9:
        # Then no more than rounding alone does to these answers: twice rounded here, once there.
        _, fused = answers(deployable.module, program, time, given, is_fused=True)
        for output, found in worst.items():
            rounding = deviation(fused[output].astype(float).tolist(), outputs[output].astype(float).tolist())
            assert found <= max(1e-9, 10.0 * rounding), output
