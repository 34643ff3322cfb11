"""Parameters drawn at random, most of them absurd: a setting is refused, or what it gives is finite and sane."""

from __future__ import annotations

import math
import random
import subprocess

import jax
import numpy as np
import pytest

from tests.tuning.builders import RESIDUAL_PAIR, SERIAL
from tests.tuning.exports.native import STRICT, needs_compiler
from tuning.exports.c99.files import write
from tuning.exports.c99.generate import generate, member
from tuning.exports.deployable import load_deployable
from tuning.exports.layout import dotted
from tuning.files.shipped import CONFIGS

EXPORTS = {
    "serial": SERIAL,
    "sensor": CONFIGS / "tuned" / "sea_sensor.toml",
    "pair": RESIDUAL_PAIR,
    "controller": CONFIGS / "studies" / "damping.toml",
    "arm": CONFIGS / "studies" / "arm.toml",
}
SETTINGS = 40
"""Of each export."""
ABSURD = (math.nan, math.inf, -math.inf, -1.0, 0.0, -1e300, -1e-300, 1e300, 1e-300, 5e-324, -5e-324)
EXTREME = (1e15, -1e15, 1e9, -1e9, 1e-6, 1e-9, 1e-15, 1e-30)
"""Some of which lie within their ranges."""

MAIN = """
#include "%(name)s.h"
#include <math.h>
#include <stdio.h>

enum { PARAMETERS = %(parameters)d, OUTPUTS = %(outputs)d };

static %(name)s self;
static %(name)s_params params;
static %(name)s_output out;
static double *const PLACES[PARAMETERS] = {%(places)s};

static %(name)s_input sample_at(int k)
{
    %(name)s_input in;
    (void)k;
    %(inputs)s
    return in;
}

/* Return how often an answer was no number, or infinite although it says that it is known. */
static int insane(void)
{
    const double values[OUTPUTS] = {%(values)s};
    int count = 0;
    for (int i = 0; i < OUTPUTS; ++i) {
        count += isnan(values[i]) || (isinf(values[i]) && %(is_sure)s);
    }
    return count;
}

int main(void)
{
    int changes;
    while (scanf("%%d", &changes) == 1) {
        %(name)s_input in = sample_at(0);
        %(name)s_defaults(&params);
        for (int n = 0; n < changes; ++n) {
            int place;
            double value;
            if (scanf("%%d %%lf", &place, &value) != 2) {
                return 1;
            }
            *PLACES[place] = value;
        }
        const int status = %(name)s_check(&params);
        const int begun = %(name)s_init(&self, &params, &in), tuned = %(name)s_tune(&self, &params);
        int wrong = 0, last = 0;
        for (int k = 0; k < 300; ++k) {
            in = sample_at(k);
            %(name)s_step(&self, &in, &out);
            last = insane();
            wrong += last;
        }
        printf("%%d %%d %%d %%d %%d\\n", status, begun, tuned, wrong, last);
    }
    return 0;
}
"""


def scalars(places):
    """Yield every number of a slot with its path."""
    for path, leaf in places:
        for index in np.ndindex(*leaf.shape):
            yield (*path, *index), leaf


def source_of(deployable, program) -> str:
    """Return a program that reads settings and says what became of each."""
    wishes = dict(zip(program.inputs.names, jax.tree.leaves(deployable.sample), strict=True))
    inputs = []
    for number, (path, _) in enumerate(scalars(program.inputs.places)):
        text = f"{0.3 + 0.1 * number} + 0.05 * sin({30 + 7 * number} * k * 1e-3)"
        if path == ("dt",):
            text = "k == 0 ? 0.0 : 1e-3"
        elif path[0] == "stiffness":
            text = repr(float(np.asarray(wishes["stiffness"])[path[1:]]))
        inputs.append(f"in.{member(path)} = {text};")
    outputs = [(path, leaf) for path, leaf in scalars(program.outputs.places) if leaf.kind == "real"]
    names = program.outputs.names
    is_sure = "out.known" if "known" in names else "out.status == 0" if "status" in names else "true"
    values = {
        "name": program.name,
        "parameters": len(list(scalars(program.parameters.places))),
        "outputs": len(outputs),
        "places": ", ".join(f"&params.{member(path)}" for path, _ in scalars(program.parameters.places)),
        "inputs": " ".join(inputs),
        "values": ", ".join(f"out.{member(path)}" for path, _ in outputs),
        "is_sure": is_sure,
    }
    return MAIN % values


@needs_compiler
@pytest.mark.failure
@pytest.mark.parametrize("name", EXPORTS)
def test_random_parameters_are_refused_or_give_sane_answers(name, tmp_path):
    deployable = load_deployable(EXPORTS[name])
    program = deployable.program()
    source = write(program, generate(program), banner="a test")
    (tmp_path / f"{source.name}.h").write_text(source.header, encoding="utf-8")
    (tmp_path / f"{source.name}.c").write_text(source.source, encoding="utf-8")
    (tmp_path / "main.c").write_text(source_of(deployable, program), encoding="utf-8")
    command = ["gcc", *STRICT, "-O0", "-o", "main", f"{source.name}.c", "main.c", "-lm"]
    built = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    places = [path for path, _ in scalars(program.parameters.places)]
    rng, settings = random.Random(name), [{}]
    while len(settings) <= SETTINGS:
        drawn = rng.sample(range(len(places)), min(len(places), rng.choice((1, 1, 2, 3))))
        settings.append(
            {place: rng.choice((*ABSURD, *ABSURD, *EXTREME, rng.uniform(-1e3, 1e3))) for place in drawn}
        )
    lines = [
        " ".join([str(len(one)), *(f"{place} {value!r}" for place, value in one.items())]) for one in settings
    ]
    ran = subprocess.run(
        ["./main"], cwd=tmp_path, input="\n".join(lines), capture_output=True, text=True, check=True
    )
    answers = [[int(word) for word in line.split()] for line in ran.stdout.splitlines()]
    assert len(answers) == len(settings)
    assert answers[0][:4] == [0, 0, 0, 0]
    assert sum(answer[0] != 0 for answer in answers) > SETTINGS // 2
    for setting, (status, begun, tuned, wrong, _) in zip(settings, answers, strict=True):
        told = {dotted(places[place]): value for place, value in setting.items()}
        assert status == begun == tuned, told
        assert wrong == 0, (status, wrong, told)
