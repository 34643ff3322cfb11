"""Parameters out of range never reach a step: `NAME_check` names them, `NAME_tune` and `NAME_init` refuse them."""

from __future__ import annotations

import math
import platform
import re
import subprocess

import numpy as np
import pytest

from tests.tuning.exports.native import STRICT, needs_compiler
from tuning.exports.c99.files import write
from tuning.exports.c99.generate import generate, member
from tuning.exports.deployable import deployable_of
from tuning.exports.program import StepProgram
from tuning.exports.ranges import Range
from tuning.files.shipped import CONFIGS
from tuning.study.loading import load_config

LEGENDRE = "estimator.basis={type='legendre', lower=-0.1, upper=0.1, order=2}"
EXPORTS = {
    "controller": ("studies/damping.toml", ()),
    "sensor": ("tuned/sea_sensor.toml", ()),
    "order": ("tuned/sea_sensor.toml", (LEGENDRE,)),
}
_MAIN = r"""
#include "%(name)s.h"
#include <math.h>
#include <stdio.h>
#include <string.h>

static %(name)s self;
static const %(name)s_input in;

static void tried(const %(name)s_params *params)
{
    %(name)s fresh;
    %(name)s_params defaults;
    const %(name)s before = self;
    const int status = %(name)s_check(params);
    const int tuned = %(name)s_tune(&self, params);
    %(name)s_defaults(&defaults);
    const int begun = %(name)s_init(&fresh, params, &in);
    printf("%%d %%d %%d %%d %%d %%s\n", status, tuned, begun, memcmp(&self, &before, sizeof self) == 0,
        memcmp(&fresh.params, &defaults, sizeof defaults) == 0, %(name)s_refusal(status));
    self = before;
}

int main(void)
{
    %(name)s_params params;
    %(name)s_defaults(&params);
    memset(&self, 0, sizeof self);
    printf("%%d\n", %(name)s_init(&self, &params, &in));
%(cases)s
    return 0;
}
"""


def beyond(limits: Range) -> list[float]:
    """Return numbers that a range does not hold."""
    wrong = [math.nan, math.inf, -math.inf]
    for limit, is_open, away in ((limits.low, limits.is_low_open, -1.0), (limits.high, limits.is_high_open, 1.0)):
        if limit is not None:
            wrong += [
                limit + away,
                limit + 1e6 * away,
                limit if is_open else float(np.nextafter(limit, away * math.inf)),
            ]
    return wrong


def ran(program: StepProgram, lines: list[str], folder) -> list[str]:
    """Return what a program prints that tries some settings."""
    source = write(program, generate(program), banner="a test")
    (folder / f"{source.name}.h").write_text(source.header, encoding="utf-8")
    (folder / f"{source.name}.c").write_text(source.source, encoding="utf-8")
    cases = "\n".join(f"    {line}" for line in lines)
    (folder / "main.c").write_text(_MAIN % {"name": program.name, "cases": cases}, encoding="utf-8")
    command = ["gcc", *STRICT, "-O1", "-o", "main", f"{source.name}.c", "main.c", "-lm"]
    built = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    return subprocess.run(["./main"], cwd=folder, capture_output=True, text=True, check=True).stdout.splitlines()


@needs_compiler
@pytest.mark.failure
@pytest.mark.parametrize("name", EXPORTS)
def test_every_parameter_out_of_range_is_refused_by_name_and_changes_nothing(name, tmp_path):
    file, settings = EXPORTS[name]
    program = deployable_of(load_config(CONFIGS / file, settings), file).program()
    lines, expected = [], []
    for number, ((path, leaf), limits) in enumerate(
        zip(program.parameters.places, program.limits.ranges, strict=True), 1
    ):
        assert leaf.shape == ()
        for value in beyond(limits):
            text = {math.inf: "INFINITY", -math.inf: "-INFINITY"}.get(value, f"{value!r}")
            text = "NAN" if math.isnan(value) else text
            place = f"params.{member(path)}"
            lines += [f"{place} = {text};", "tried(&params);", f"{program.name}_defaults(&params);"]
            expected.append((number, program.parameters.names[number - 1]))
    for number, order in enumerate(program.limits.orders, len(program.parameters.places) + 1):
        lower, upper = (f"params.{member(path)}" for path in (order.lower, order.upper))
        lines += [f"{lower} = {upper};", "tried(&params);", f"{program.name}_defaults(&params);"]
        expected.append((number, ".".join(map(str, order.lower))))
    assert len(program.limits.orders) == (name == "order")
    first, *answers = ran(program, lines, tmp_path)
    assert first == "0"
    assert len(answers) == len(expected) > 15
    for (number, parameter), answer in zip(expected, answers, strict=True):
        status, tuned, begun, is_kept, is_default, words = answer.split(" ", 5)
        assert (int(status), int(tuned), int(begun)) == (number, number, number), answer
        assert (is_kept, is_default) == ("1", "1"), answer
        assert words.startswith(f"{parameter}: must be "), answer


@needs_compiler
@pytest.mark.structure
@pytest.mark.skipif(platform.machine() != "x86_64", reason="needs the instructions of x86-64")
def test_no_product_is_fused_whatever_the_flags_and_fast_arithmetic_is_refused(tmp_path):
    file, settings = EXPORTS["sensor"]
    program = deployable_of(load_config(CONFIGS / file, settings), file).program()
    source = write(program, generate(program), banner="a test")
    (tmp_path / f"{source.name}.h").write_text(source.header, encoding="utf-8")

    def compiled(text: str, *options: str) -> subprocess.CompletedProcess[str]:
        (tmp_path / "one.c").write_text(text, encoding="utf-8")
        command = ["gcc", "-std=gnu99", "-O2", "-mfma", "-S", "-o", "-", *options, "one.c"]
        return subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)

    # The flags do fuse where nothing forbids it, and forbid it in the sources as they are.
    assert "vfmadd" in compiled(source.source.replace("fp-contract=off", "fp-contract=fast")).stdout
    for options in ((), (f"-D{source.name.upper()}_SINGLE",), ("-ffp-contract=fast", "-O3")):
        plain = compiled(source.source, *options)
        assert plain.returncode == 0, plain.stderr
        assert not re.search("vf[n]?m(add|sub)", plain.stdout), options
    refused = compiled(source.source, "-ffast-math")
    assert refused.returncode != 0
    assert "compile without -ffast-math" in refused.stderr
