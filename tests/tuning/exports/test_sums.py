"""Sums over all samples go on in single precision, long after `weight += 1` would have stopped at 2^24."""

from __future__ import annotations

import subprocess

import jax
import jax.numpy as jnp
import pytest

from tests.tuning.exports.native import STRICT, needs_compiler
from tests.tuning.exports.test_controllers import CONTROLLERS, study_of
from tests.vsajax.estimators.registry import ESTIMATORS, full_recording
from tuning.exports.c99.files import write
from tuning.exports.c99.generate import generate, member
from tuning.exports.deployable import deployable_of
from tuning.exports.layout import dotted
from tuning.exports.program import program_of, slot_of
from tuning.kinds.estimation.deployable import inputs_of, sample_of

AHEAD = 2.0**26
"""Where the sums stand: 18 h of ones at 1 kHz, and four times what single precision counts to."""
EXTREMES = {"lowest", "highest", "position_before", "velocity_before", "position_peak", "velocity_peak"}
"""Parts of a state that stay as they are where nothing exceeds them: no sums."""

MAIN = """
#include "one.h"
#include <math.h>
#include <stdio.h>

static one self;

static one_input sample_at(int k)
{
    one_input in;
    %(inputs)s
    return in;
}

int main(void)
{
    one_params params;
    one_output out;
    one_input in = sample_at(0);
    one_defaults(&params);
    if (one_init(&self, &params, &in) != 0) {
        return 1;
    }
    for (int k = 0; k < 400; ++k) {
        if (k == 200) {
            %(shifts)s
        }
        in = sample_at(k);
        one_step(&self, &in, &out);
    }
    %(shown)s
    return 0;
}
"""


def program_called_one(name: str):
    """Return the program of an estimator or a controller."""
    if name in ESTIMATORS:
        module = ESTIMATORS[name]
        return program_of(module, sample_of(inputs_of(module)), name="one", title=name)
    deployable = deployable_of(study_of(CONTROLLERS[name]), "a test")
    return program_of(deployable.module, deployable.sample, name="one", title=name)


def run(program, folder, *options: str) -> dict[str, float]:
    """Return by how much every sum grew within 200 samples after it was set far ahead, and the torque."""
    sums = [path for path, leaf in program.state.places if leaf.is_sum]
    inputs = [
        f"in.{member(path)} = "
        + (
            "k == 0 ? 0 : (one_real)1e-3;"
            if path == ("dt",)
            else f"(one_real)(0.05 * sin((30 + {7 * i}) * k * 1e-3));"
        )
        for i, (path, _) in enumerate(program.inputs.places)
    ]
    # The balance is what the impulse is subtracted from.
    shifts = [f"self.state.{member(p)} {'-' if p[-1] == 'balance' else '+'}= {AHEAD};" for p in sums]
    since = {p: f"self.state.{member(p)} {'+' if p[-1] == 'balance' else '-'} {AHEAD}" for p in sums}
    shown = [f'printf("{dotted(p)} %.17g\\n", (double)({text}));' for p, text in since.items()]
    if "elastic_torque" in program.outputs.names:
        shown.append('printf("elastic_torque %.17g\\n", (double)out.elastic_torque);')
    source = write(program, generate(program), banner="a test")
    text = MAIN % {"inputs": " ".join(inputs), "shifts": " ".join(shifts), "shown": " ".join(shown)}
    for name, contents in {"one.h": source.header, "one.c": source.source, "main.c": text}.items():
        (folder / name).write_text(contents, encoding="utf-8")
    command = ["gcc", *STRICT, "-O1", *options, "-o", "main", "one.c", "main.c", "-lm"]
    built = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    ran = subprocess.run(["./main"], cwd=folder, capture_output=True, text=True, check=True)
    return {name: float(value) for name, value in (line.split() for line in ran.stdout.splitlines())}


@needs_compiler
@pytest.mark.equivalence
@pytest.mark.parametrize("name", ["residual", "algebraic", "unequal pair", "switch by release"])
def test_sums_go_on_in_single_precision(name, tmp_path):
    program = program_called_one(name)
    single, double = run(program, tmp_path, "-DONE_SINGLE"), run(program, tmp_path)
    assert single.keys() == double.keys()
    assert any(key.endswith(("weight", "since_peak")) for key in double)
    for key, value in double.items():
        assert single[key] == pytest.approx(value, rel=2e-3, abs=1e-5), key
        # What is added to the others may be too little for double precision too.
        assert value != 0.0 or not key.endswith(("weight", "seen", "impulse")), key


BRIEF = {"residual", "algebraic", "pid", "switch by release"}
STATEFUL = [*ESTIMATORS, *(name for name in CONTROLLERS if "switch" in name or "pid" in name)]


@pytest.mark.contract
@pytest.mark.parametrize(
    "name", [name if name in BRIEF else pytest.param(name, marks=pytest.mark.slow) for name in STATEFUL]
)
def test_every_part_of_a_state_that_adds_up_is_declared_a_sum(name):
    module = (
        ESTIMATORS[name] if name in ESTIMATORS else deployable_of(study_of(CONTROLLERS[name]), "a test").module
    )
    signals = full_recording(40).samples()
    needs = {"dt", *(inputs_of(module) if name in ESTIMATORS else ("link_position", "motor_position"))}
    samples = signals._replace(**{name: None for name in signals._fields if name not in needs})
    state = module.init(jax.tree.map(lambda x: x[0], samples))

    @jax.jit
    def step(state, tangent, sample):
        return jax.jvp(lambda s: module.step(s, sample)[0], (state,), (tangent,))

    zero = jax.tree.map(jnp.zeros_like, state)
    for k in range(20):
        state = step(state, zero, jax.tree.map(lambda x, k=k: x[k], samples))[0]
    sample, structure = jax.tree.map(lambda x: x[20], samples), jax.tree.structure(state)
    for n, (path, leaf) in enumerate(slot_of(state, is_optional=True).places):
        if leaf.kind == "real" and not leaf.shape:
            tangents = [x + (1.0 if i == n else 0.0) for i, x in enumerate(jax.tree.leaves(zero))]
            moved, slopes = step(state, jax.tree.unflatten(structure, tangents), sample)
            adds = jax.tree.leaves(moved)[n] != jax.tree.leaves(state)[n]
            if adds and jax.tree.leaves(slopes)[n] == 1.0 and path[-1] not in EXTREMES:
                assert leaf.is_sum, dotted(path)
