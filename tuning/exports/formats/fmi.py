"""FMI 2 and 3: the generated C behind the functions of a co-simulation FMU, built here, sources inside."""

from __future__ import annotations

import io
import platform
import re
import shutil
import subprocess
import tempfile
import uuid
import zipfile
from functools import partial
from importlib import import_module, metadata
from pathlib import Path
from typing import Any

import jax
import numpy as np

from tuning.exports.artefact import Artefact, Subject
from tuning.exports.c99.files import member, write
from tuning.exports.c99.generate import generate
from tuning.exports.c99.printing import decimal
from tuning.exports.checks.fmi_example import example
from tuning.exports.flatten import Untraceable
from tuning.exports.layout import dotted
from tuning.exports.program import Slot
from tuning.exports.ranges import Range
from tuning.exports.rendering import render
from tuning.exports.units import base_units
from tuning.files.errors import input_error

_HEADERS = {
    2: ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
    3: ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h"),
}
_TYPES = {"real": "REAL", "bool": "BOOLEAN", "int": "INTEGER"}
_FLAGS = [
    "-std=c99",
    "-ffp-contract=off",
    "-pedantic",
    "-Wall",
    "-Wextra",
    "-O2",
    "-fPIC",
    "-shared",
    "-fvisibility=hidden",
]
_USAGE = """```python
{example}```

Co-simulation. The sample at the beginning of a communication step is processed by it, with the time since the
beginning of the step before as dt: outputs at time t are the answers to the sample one step earlier. Before the
first step they are those at rest, and nothing is known. {steps} The parameters are tunable: changed between steps,
they keep the state. What is refused ends with an error, and the master's logger is told why (category
`logStatusError`). The binary is for {platform}; the sources are inside (`fmpy compile {name}.fmu`, or any C99
compiler)."""
_ONLY = "this FMU is for co-simulation only"
_ANY_STEPS = "Steps may be irregular, and must follow one another."
_EQUAL_STEPS = "Every step must be of {step} s: this {noun} counts samples, and refuses any other step."


def write_fmi(subject: Subject, version: int) -> Artefact:
    """Return an FMU for version 2 or 3 of the standard.

    Raises:
        InputError: no C compiler was found, or it refuses the sources.
        Untraceable: more than double-precision numbers and booleans would have to cross the interface.
    """
    program = subject.program
    token = "{" + str(uuid.uuid5(uuid.NAMESPACE_OID, f"{subject.identity} {program.name} fmi{version}")) + "}"
    source = write(program, generate(program), banner=subject.banner)
    variables = _variables(subject)
    golden, deployable = subject.golden, subject.deployable
    sample_time = deployable.sample_time if deployable.needs_regular_clock else None
    fixed_step = None if sample_time is None else decimal(sample_time)
    values: dict[str, Any] = {
        "name": program.name,
        "title": program.title,
        "token": token,
        "version": metadata.version("vsajax"),
        "variables": variables,
        "has_clock": "dt" in program.inputs.names,
        "units": {v["unit"]: base_units(v["unit"]) for v in variables if v["unit"]},
        "start": decimal(float(golden.time[0])),
        "stop": decimal(float(golden.time[-1])),
        "step": None if golden.step is None else decimal(golden.step),
        "fixed_step": fixed_step,
        "noun": deployable.noun,
        "is_guarded": bool(program.guarded),
        "sources": [f"{program.name}.c", f"fmi{version}.c", "unsupported.c"],
    }
    sources = {f"{program.name}.h": source.header, f"{program.name}.c": source.source}
    sources |= {name: render(name, **values) for name in ("instance.h", f"fmi{version}.c")}
    sources |= _headers(version)
    sources["unsupported.c"] = _unsupported(program.name, version, sources)
    binary = _build(program.name, sources, values["sources"])
    files: dict[str, str | bytes] = {
        "modelDescription.xml": render(f"fmi{version}.xml", **values),
        f"binaries/{_platform(version)}/{program.name}{_suffix()}": binary,
        **{f"sources/{name}": text for name, text in sources.items()},
    }
    if version == 3:
        files["sources/buildDescription.xml"] = render("buildDescription.xml", **values)
    file = f"{program.name}.fmu"
    # simulate_fmu interpolates its input, and what is no number spoils its neighbours.
    replayed = {
        "step": golden.step if golden.is_finite else None,
        "last": float(sample_time or golden.step or np.diff(golden.time)[-1]),
    }
    usage = _USAGE.format(
        name=program.name,
        platform=_platform(version),
        example=example(file, version, **replayed),
        steps=_ANY_STEPS if fixed_step is None else _EQUAL_STEPS.format(step=fixed_step, noun=deployable.noun),
    )
    figures = {"fmi": {"version": version, "token": token, **replayed}}
    return Artefact({file: _zipped(files)}, "fmi", usage, figures, helpers=("fmi_example",))


def _variables(subject: Subject) -> list[dict[str, Any]]:
    """Return inputs, outputs, parameters and time, each number a variable; their order is their reference."""
    program = subject.program
    starts = dict(zip(program.inputs.names, jax.tree.leaves(program.inputs.tree), strict=True))
    rows = []
    for path, leaf in program.inputs.places:
        one, value = Slot(program.inputs.layout, [(path, leaf)], None), np.asarray(starts[dotted(path)], float)
        rows += _rows(one, "in", "INPUT", "", start=lambda index, value=value: float(value[index]))
    rows += _rows(program.outputs, "out", "OUTPUT", "out.", start=lambda _: None)
    places = zip(program.parameters.places, program.defaults, program.limits.ranges, strict=True)
    for (path, leaf), value, limits in places:
        one = Slot(program.parameters.layout, [(path, leaf)], None)
        rows += _rows(
            one, "params", "PARAMETER", "", start=lambda index, value=value: float(value[index]), limits=limits
        )
    rows.append({"name": "time", "type": "REAL", "role": "TIME", "place": "time", "unit": "s", "start": None})
    for n, row in enumerate(rows):
        role = row["role"]
        row["reference"] = n
        row["causality"] = {"TIME": "independent"}.get(role, role.lower())
        row["variability"] = {"PARAMETER": "tunable", "OUTPUT": "discrete"}.get(role, "continuous")
        row.setdefault("limits", {})
        row.setdefault("meaning", "")
        row["start"] = None if row["start"] is None else decimal(row["start"])
    return rows


def _rows(slot: Slot, root: str, role: str, prefix: str, *, start: Any, limits: Range | None = None) -> list[dict]:
    rows = []
    for path, leaf in slot.places:
        if role == "INPUT" and path == ("dt",):
            continue
        for index in np.ndindex(*leaf.shape):
            whole = (*path, *index)
            bounds = {} if limits is None else {"min": limits.low, "max": limits.high}
            rows.append(
                {
                    "name": f"{prefix}{dotted(whole)}".replace("][", ","),
                    "type": _TYPES[leaf.kind],
                    "role": role,
                    "place": f"{root}.{member(whole)}",
                    "unit": leaf.unit if base_units(leaf.unit) is not None else "",
                    "meaning": leaf.meaning,
                    "start": start(index),
                    "limits": {key: decimal(value) for key, value in bounds.items() if value is not None},
                }
            )
    return rows


def _headers(version: int) -> dict[str, str]:
    """Return the headers of the standard (2-clause BSD), as FMPy ships them."""
    folder = Path(str(import_module("fmpy").__file__)).parent / "c-code"
    return {name: (folder / name).read_text(encoding="utf-8") for name in _HEADERS[version]}


def _unsupported(name: str, version: int, sources: dict[str, str]) -> str:
    """Return functions that refuse, and say so, for all that the standard names and this FMU does not do."""
    text = sources[_HEADERS[version][1]]
    types = re.findall(r"typedef\s+([\w\s]+\*?)\s*\b(fmi\dW?\w+)TYPE\s*\(([^;]*)\);", text.replace("\n", " "))
    own = sources[f"fmi{version}.c"]
    kind = {2: "fmi2Component", 3: "fmi3Instance"}[version]
    lines = [
        f'/* What this FMU does not offer. */\n#include "{_HEADERS[version][0]}"\n\n#include <stddef.h>\n',
        f"fmi{version}Status {name}_unsupported({kind} instance, const char *function);\n",
    ]
    wanted = set(re.findall(rf"\b(fmi{version}\w+?);", sources[_HEADERS[version][0]]))
    for result, function, arguments in types:
        if function not in wanted or re.search(rf"\b{function}\(", own):
            continue
        named = [re.findall(r"\w+", argument.partition("[")[0])[-1] for argument in arguments.split(",")]
        body = [f"(void){one};" for one in named]
        if "Status" in result:
            body.append(f'return {name}_unsupported({named[0]}, "{function}");')
        else:
            told = f'logMessage(instanceEnvironment, fmi3Error, "logStatusError", "{function}: {_ONLY}");'
            body.append(f"if (logMessage != NULL) {{ {told} }}")
            body.append("return NULL;")
        inside = "\n    ".join(body)
        lines.append(f"{result.strip()} {function}({' '.join(arguments.split())})\n{{\n    {inside}\n}}\n")
    return "\n".join(lines)


def _build(name: str, sources: dict[str, str], compiled: list[str]) -> bytes:
    compiler = shutil.which("gcc") or shutil.which("clang") or shutil.which("cc")
    if compiler is None:
        raise input_error("--to fmi", "needs a C compiler", "install gcc or clang")
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for file, text in sources.items():
            (folder / file).write_text(text, encoding="utf-8")
        built = subprocess.run(
            [compiler, *_FLAGS, "-o", f"{name}.so", *compiled, "-lm"],
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
        )
        if built.returncode or built.stderr:
            raise Untraceable(f"{compiler} refuses the generated sources: {built.stderr[:1000]}")
        return (folder / f"{name}.so").read_bytes()


def _platform(version: int) -> str:
    machine, system = platform.machine().lower(), platform.system().lower()
    if version == 2:
        return {"linux": "linux64", "darwin": "darwin64"}.get(system, "win64")
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(machine, machine)
    return f"{machine}-{system}"


def _suffix() -> str:
    return {"linux": ".so", "darwin": ".dylib"}.get(platform.system().lower(), ".dll")


def _zipped(files: dict[str, str | bytes]) -> bytes:
    """Return a zip file that depends on its contents alone."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, contents in sorted(files.items()):
            archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), contents)
    return buffer.getvalue()


write_fmi2 = partial(write_fmi, version=2)
write_fmi3 = partial(write_fmi, version=3)
