"""MAT: everything that is known of what is exported, for MATLAB and Octave."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from scipy import io as scipy_io

from tuning.exports.artefact import Artefact, Subject
from tuning.exports.golden import Columns, assembled
from tuning.exports.layout import Path, dotted
from tuning.exports.program import Slot
from tuning.study.base import resolved

_USAGE = """```matlab
s = load('{name}.mat');
s.parameters              % the tunable numbers, SI
s.config                  % the whole configuration
plot(s.golden.time, s.golden.outputs.{first})
```

`s.golden` holds the golden recording: `time`, `inputs`, `outputs`; MATLAB counts from one, so `sides[0]` is
`sides_1`. Numbers are doubles, what is true or false is logical. Features that are absent are left out."""


def write_mat(subject: Subject) -> Artefact:
    """Return a MAT v5 file."""
    program, golden = subject.program, subject.golden
    contents = {
        "parameters": _tree(zip((path for path, _ in program.parameters.places), program.defaults, strict=True)),
        "config": resolved(subject.deployable.config),
        "golden": {
            "time": golden.time,
            "inputs": _signals(program.inputs, golden.inputs),
            "outputs": _signals(program.outputs, golden.outputs),
        },
        "about": {"banner": subject.banner, "study_hash": subject.identity, "units": "SI: rad, s, N·m, N·m/rad"},
    }
    buffer = io.BytesIO()
    scipy_io.savemat(buffer, plain(contents), long_field_names=True, do_compression=True, oned_as="column")
    first = program.outputs.names[0]
    usage = _USAGE.format(name=program.name, first=first)
    return Artefact({f"{program.name}.mat": buffer.getvalue()}, "mat", usage)


def _signals(slot: Slot, columns: Columns) -> dict[str, Any]:
    arrays = assembled(slot, columns)
    return _tree((path, arrays[dotted(path)]) for path, _ in slot.places)


def _tree(items: Any) -> dict[str, Any]:
    """Return numbers at their paths as nested tables; MATLAB counts from one, so ``sides[0]`` is ``sides_1``."""
    root: dict[str, Any] = {}
    for path, value in items:
        keys = _keys(path)
        table = root
        for key in keys[:-1]:
            table = table.setdefault(key, {})
        table[keys[-1]] = value
    return root


def _keys(path: Path) -> list[str]:
    keys: list[str] = []
    for key in path:
        if isinstance(key, int):
            keys[-1] = f"{keys[-1]}_{key + 1}"
        else:
            keys.append(key)
    return keys


def plain(value: Any) -> Any:
    """Return a value as MATLAB computes with it: numbers as doubles, names that are no identifiers made into such.

    MATLAB and Octave round what they multiply by a whole number of another type. A whole number that is no double
    (a seed may be one) becomes text.
    """
    if isinstance(value, dict):
        return {_field(str(key)): plain(inner) for key, inner in value.items()}
    if isinstance(value, np.ndarray) and value.dtype.kind in "iu":
        return value.astype(float)
    if isinstance(value, int) and not isinstance(value, bool):
        return float(value) if float(value) == value else str(value)
    if isinstance(value, list | tuple):
        is_numeric = all(isinstance(inner, int | float) and not isinstance(inner, bool) for inner in value)
        if is_numeric:
            return np.asarray(value, float)
        cells = np.empty(len(value), dtype=object)
        cells[:] = [plain(inner) for inner in value]
        return cells
    return value


def _field(key: str) -> str:
    clean = "".join(letter if letter.isascii() and (letter.isalnum() or letter == "_") else "_" for letter in key)
    return clean if clean[:1].isalpha() else f"x{clean}"
