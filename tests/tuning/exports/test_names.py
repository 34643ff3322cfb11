"""Names and texts of the user's stand in every format as what they are, and never as that format's own."""

from __future__ import annotations

import dataclasses
import json
import random
import re
import subprocess
import tomllib
import xml.etree.ElementTree as ElementTree
import zipfile
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

from tests.tuning.exports.native import needs_compiler
from tuning.exports.artefact import Artefact, Subject
from tuning.exports.deployable import deployable_of, load_deployable
from tuning.exports.escaping import comment_of_c, string_of_c, text_of_markdown, text_of_xml
from tuning.exports.export import banner_of
from tuning.exports.formats import fmi
from tuning.exports.formats.config import add_companions
from tuning.exports.formats.registry import writer_of
from tuning.exports.golden import Golden
from tuning.exports.manifest import manifest_of
from tuning.exports.names import LONGEST, checked_name, identifier_of
from tuning.exports.readme import readme_of
from tuning.files.errors import InputError
from tuning.files.shipped import CONFIGS
from tuning.files.text import plain

SENSOR = CONFIGS / "tuned" / "sea_sensor.toml"
IDENTIFIER = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
TAKEN = (
    *(
        "cortex_m",
        "math",
        "string",
        "stdbool",
        "stdint",
        "main",
        "sinf",
        "pthread",
        "con",
        "null",
        "end",
        "lambda",
    ),
    *("replay", "start", "typical", "check", "hold", "is_sound", "advance", "prepare", "take_time", "sample_of"),
    *("class", "int", "namespace", "fmi2_x", "harness", "instance", "sem", "mtx", "linux", "j0", "inf", "on"),
)
HOSTILE = (
    "*/ int evil = 1; /*",
    "a \\",
    "??/",
    'say "hi" %s %n',
    "--> <script>alert(1)</script> & ]]>",
    "| `a` | **b** | [c](d) | # e",
    ": {x: 1} # y",
    "$(touch evil) `touch evil`",
    "größe 関節",
)


def test_names_are_identifiers_that_mean_nothing_else():
    rng = random.Random(1)
    letters = "abzAZ019_ -./*\\\n\u202eé関%\"'"
    drawn = ["".join(rng.choices(letters, k=rng.randrange(70))) for _ in range(500)]
    for text in (*TAKEN, *HOSTILE, *drawn, "", "x_state", "a__b", "A" * 60, "x" * 43 + "_init_more"):
        name = identifier_of(text)
        assert IDENTIFIER.fullmatch(name), (text, name)
        assert len(name) <= LONGEST
        assert name not in TAKEN
        assert identifier_of(name) == checked_name(name, "--name") == name
    assert [identifier_of(n) for n in ("sea-sensor", "2nd try", "double", "*/", "math", "arm_state")] == [
        "sea_sensor",
        "joint_2nd_try",
        "joint_double",
        "joint",
        "joint_math",
        "arm_state_joint",
    ]


@pytest.mark.failure
@pytest.mark.parametrize(
    "text", [*TAKEN, "Left", "a__b", "9", "", "a b", "x" * 49, "größe", "../a", "left_params"]
)
def test_a_name_that_cannot_stand_everywhere_is_refused_with_one_that_can(text):
    with pytest.raises(InputError, match="must be an identifier of C") as caught:
        checked_name(text, "--name")
    offered = str(caught.value).rpartition("--name ")[2].split()[0]
    assert checked_name(offered, "--name") == offered


def test_texts_lose_what_a_format_would_read():
    for text in (*HOSTILE, "a\nb: 1", "\x00\x1b[31m", "\u202e/*"):
        comment = comment_of_c(text)
        assert not re.search(r"\*/|/\*|\\|\n|\?\?/", comment), comment
        assert ElementTree.fromstring(f'<a b="{text_of_xml(text)}">{text_of_xml(text)}</a>').get("b") == plain(
            text
        )
        page = text_of_markdown(text)
        assert not re.search(r"(?<!\\)[<>|`*#]", page), page
        assert re.fullmatch(r'([^"\\\n]|\\.)*', string_of_c(text))
        assert plain(text).isprintable()


@pytest.fixture(scope="module")
def sensor():
    """Return what is exported and its program, traced once; the tables below give it other names."""
    deployable = load_deployable(SENSOR)
    program = deployable.program()
    assert (program.name, program.title) == ("sea_sensor", f"sea-sensor: {deployable.title}")
    return deployable, program


def subject_called(text: str, sensor) -> Subject:
    """Return the sensor's export as if study, file and recording were called by a text."""
    deployable, program = sensor
    program = dataclasses.replace(program, name=identifier_of(text), title=f"{text}: {deployable.title}")
    renamed = deployable_of(deployable.config.model_copy(update={"name": text}), str(SENSOR))
    still = np.zeros(3)
    inputs, outputs = (dict.fromkeys(slot.names, still) for slot in (program.inputs, program.outputs))
    golden = Golden(text, np.arange(3) * 1e-3, inputs, outputs, {})
    return Subject(renamed, program, golden, banner_of(SENSOR.with_name(file_name(text)), "0123"), "0123")


def file_name(text: str) -> str:
    """Return a text as far as a disk takes it."""
    return text.replace("/", "_") + ".toml"


@needs_compiler
@pytest.mark.failure
@pytest.mark.parametrize("text", [*HOSTILE, "a\nb: 1\n\u202e"])
def test_hostile_names_stand_in_every_format_as_text(text, sensor, tmp_path, monkeypatch):
    pytest.importorskip("fmpy")
    # What is compiled is the C below; an FMU has the same.
    monkeypatch.setattr(fmi, "_build", lambda *_: b"")
    subject = subject_called(text, sensor)
    for target in ("c99", "fmi2", "fmi3", "ros2", "mat", "toml", "json"):
        artefact = writer_of(target)(subject)
        manifest = manifest_of(subject, target, SENSOR.with_name(file_name(text)), artefact)
        page = readme_of(subject, artefact, manifest, [])
        assert page.splitlines()[0] == f"# {text_of_markdown(subject.program.title)}"
        assert json.loads(json.dumps(manifest))["name"] == subject.program.name
        assert all(re.fullmatch(r"[\w.]+", name) for name in artefact.files), artefact.files
        for name, contents in artefact.files.items():
            (tmp_path / name).write_bytes(contents if isinstance(contents, bytes) else contents.encode())
    name = subject.program.name
    compile_it = ["gcc", "-std=c99", "-trigraphs", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", f"{name}.c"]
    built = subprocess.run(compile_it, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    for source in (f"{name}.c", f"{name}.h"):
        assert "evil = 1" not in re.sub(r"/\*.*?\*/", "", (tmp_path / source).read_text(), flags=re.DOTALL)
    tables = {f"{name}_params.yaml": {name}, f"{name}_parameters.yaml": {f"{name}_parameters"}}
    tables[f"{name}_controller.yaml"] = {"controller_manager", name}
    for file, keys in tables.items():
        assert set(yaml.safe_load((tmp_path / file).read_text())) == keys
    with zipfile.ZipFile(tmp_path / f"{name}.fmu") as archive:
        description = ElementTree.fromstring(archive.read("modelDescription.xml"))
    assert description.get("description") == plain(subject.program.title)
    if text.isprintable():
        assert tomllib.loads((tmp_path / "estimator.toml").read_text())["name"] == text


@pytest.mark.cli
@pytest.mark.failure
@pytest.mark.parametrize("letter", ["\n", "\x00", "\x1b", "\u202e", "\u2066", "\u2028", "\u200b", "\x7f", "\t"])
def test_a_name_with_a_character_that_is_not_shown_is_refused_by_check(vsajax, tmp_path, letter):
    study = tmp_path / "study.toml"
    escaped = f"\\u{ord(letter):04X}"
    study.write_text(SENSOR.read_text().replace('name = "sea-sensor"', f'name = "sea{escaped}sensor"'))
    assert escaped in study.read_text()
    ended = vsajax("check", study)
    assert (ended.code, ended.out) == (2, "")
    assert f"{study}: name: got 'sea" in ended.err
    assert f"U+{ord(letter):04X}" in ended.err
    assert ended.err.count("\n") <= 3


@pytest.mark.failure
@pytest.mark.parametrize(
    "name", ["README.md", "readme.MD", "check.py", "checking.py", "manifest.json", "schema.json"]
)
def test_a_urdf_does_not_take_the_place_of_a_file_of_the_export(name):
    subject: Any = SimpleNamespace(deployable=SimpleNamespace(companions={name: b"<robot/>"}))
    with pytest.raises(InputError, match="an export writes a file of that name"):
        add_companions(Artefact({"designer.toml": "", "schema.json": ""}, "config", ""), subject)


@pytest.mark.cli
@pytest.mark.failure
def test_a_name_is_refused_before_anything_is_written(vsajax, tmp_path):
    ended = vsajax("export", SENSOR, "--to", "c99", "-o", tmp_path / "out", "--name", "math")
    assert (ended.code, ended.out) == (2, "")
    assert "--name: got 'math'" in ended.err
    assert "--name joint_math" in ended.err
    assert not (tmp_path / "out").exists()


@needs_compiler
@pytest.mark.equivalence
def test_two_exports_of_one_study_link_and_run_in_one_program(sensor, tmp_path):
    for name in ("left", "right"):
        subject = subject_called("sea-sensor", sensor)
        subject = dataclasses.replace(subject, program=subject.deployable.program(name))
        artefact = writer_of("c99")(subject)
        assert "`--name`" in artefact.usage
        (tmp_path / name).mkdir()
        for file in (f"{name}.h", f"{name}.c"):
            (tmp_path / name / file).write_text(str(artefact.files[file]))
    (tmp_path / "main.c").write_text(
        """
#include "left.h"
#include "right.h"
#include <stdio.h>

static left one;
static right other;

int main(void)
{
    left_params p;
    right_params q;
    left_output a;
    right_output b;
    left_defaults(&p);
    right_defaults(&q);
    left_init(&one, &p, &(left_input){0});
    right_init(&other, &q, &(right_input){0});
    for (int k = 1; k < 100; ++k) {
        left_step(&one, &(left_input){.dt = 1e-3, .deflection = 1e-4 * k, .elastic_torque = 0.01 * k}, &a);
        right_step(&other, &(right_input){.dt = 1e-3, .deflection = 1e-4 * k, .elastic_torque = 0.02 * k}, &b);
    }
    printf("%.6f %.6f\\n", a.stiffness, b.stiffness);
    return 0;
}
"""
    )
    sources = ["main.c", "left/left.c", "right/right.c"]
    command = [
        "gcc",
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-Ileft",
        "-Iright",
        *sources,
        "-o",
        "main",
        "-lm",
    ]
    built = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    ran = subprocess.run(["./main"], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert [float(word) for word in ran.stdout.split()] == pytest.approx([100.0, 200.0], rel=1e-3)
