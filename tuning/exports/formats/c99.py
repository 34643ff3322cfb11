"""C99: one header, one source, and the harness that replays the golden recording."""

from __future__ import annotations

from typing import Any

import numpy as np

from tuning.exports.artefact import Artefact, Subject
from tuning.exports.c99.files import member, write
from tuning.exports.c99.generate import generate
from tuning.exports.layout import dotted
from tuning.exports.program import Slot
from tuning.exports.rendering import render

_USAGE = """```c
#include "{name}.h"

{name} self;               /* no memory is allocated, nothing is global */
{name}_params params;
{name}_output answer;

{name}_defaults(&params);
int refused = {name}_init(&self, &params, &first);  /* the first sample: nothing is answered yet */
{name}_step(&self, &sample, &answer);           /* every sample, the first one (dt = 0) too */
refused = {name}_tune(&self, &params);          /* other parameters, the same state */
if (refused != 0) {{
    puts({name}_refusal(refused));              /* which parameter, and where it must lie */
}}
```

Parameters are checked: `{name}_check(&params)` returns 0, or which parameter lies outside the ranges below,
counted from 1 in the table's order; not a number and infinite are outside. `{name}_tune` then keeps the parameters
before, and `{name}_init` takes those that were exported; both return what `{name}_check` does.

`-D{NAME}_SINGLE` compiles for single precision. Do not compile with `-ffast-math`, which `{name}.c` refuses.
Products must not be fused with sums, as gcc does by default on Cortex-M4F, M7 and wherever there is an FMA:
`{name}.c` forbids it to GCC, clang and MSVC by itself; for other compilers set `-ffp-contract=off` or its like.
Every public name begins with `{name}`, as do header and source: two exports of one study in one program need
two names (`--name` of `vsajax export`).

Without Python, `make check`, `make sanitize`, `make time`, `make cortex-m4` and `make cortex-m7` do what
`check.py` does."""


def write_c99(subject: Subject) -> Artefact:
    """Return header, source, harness, a smallest program for a microcontroller, and a Makefile."""
    program = subject.program
    generated = generate(program)
    source = write(program, generated, banner=subject.banner)
    values: dict[str, Any] = {
        "name": program.name,
        "inputs": scalars(program.inputs),
        "outputs": scalars(program.outputs),
    }
    files: dict[str, str | bytes] = {f"{source.name}.h": source.header, f"{source.name}.c": source.source}
    files |= {name: render(name, **values) for name in ("harness.c", "cortex_m.c", "Makefile")}
    counted = generated.operations
    figures = {
        "worst_case_operations": dict(counted.most_common()),
        "worst_case_operations_total": sum(counted.values()),
        "state_bytes": {"double": program.state_bytes(8), "single": program.state_bytes(4)},
    }
    usage = _USAGE.format(name=program.name, NAME=program.name.upper())
    return Artefact(files, "c99", usage, figures)


def scalars(slot: Slot) -> list[dict[str, Any]]:
    """Return every number of a slot: its name, and where it lies in the struct."""
    found = []
    for path, leaf in slot.places:
        for index in np.ndindex(*leaf.shape):
            whole = (*path, *index)
            found.append({"name": dotted(whole), "place": member(whole), "is_bool": leaf.kind == "bool"})
    return found
