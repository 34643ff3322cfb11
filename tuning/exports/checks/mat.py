"""Loads the MAT file and compares it with the manifest and the golden recording."""

import json
import re
from typing import Any

from checking import HERE, Result, as_columns, compare, read_golden, run_checks  # pyright: ignore[reportMissingImports]

MANIFEST = json.loads((HERE / "manifest.json").read_text(encoding="utf-8"))


def load() -> Any:
    """Return the file's contents as nested tables."""
    from scipy import io

    return io.loadmat(str(HERE / MANIFEST["files"][0]), simplify_cells=True)


def find(tree: Any, name: str):
    """Return what lies at a dotted name; an index is part of the field's name, and counts from one."""
    for key in name.split("."):
        tree = tree[re.sub(r"\[(\d+)\]", lambda match: f"_{int(match[1]) + 1}", key)]
    return tree


def parameters() -> Result:
    """Compare every parameter with the manifest."""
    import numpy as np

    found = load()["parameters"]
    wrong = [
        row["name"]
        for row in MANIFEST["parameters"]
        if not np.array_equal(find(found, row["name"]), row["default"])
    ]
    told = f"{len(MANIFEST['parameters'])} equal to the manifest's, to the last bit"
    return Result("parameters", "failed" if wrong else "passed", ", ".join(wrong) or told)


def recording() -> Result:
    """Compare the recording with golden.csv."""
    golden, found = read_golden(), load()["golden"]
    recorded = {"time": golden.time, **{f"in.{k}": v for k, v in golden.inputs.items()}, **golden.outputs}
    answers = {"time": found["time"]}
    answers |= {f"in.{row['name']}": find(found["inputs"], row["name"]) for row in MANIFEST["inputs"]}
    answers |= {row["name"]: find(found["outputs"], row["name"]) for row in MANIFEST["outputs"]}
    return compare("recording", "read back", as_columns(answers), recorded)


def types() -> Result:
    """See that every number is a double: MATLAB and Octave round what they multiply by other whole numbers."""
    from scipy import io

    contents = io.loadmat(str(HERE / MANIFEST["files"][0]), struct_as_record=True, mat_dtype=True)
    odd: list[str] = []

    def walk(place: str, value: Any) -> None:
        if value is None:  # a table without entries
            return
        if value.dtype.names:
            for name in value.dtype.names:
                for entry in value[name].flat:
                    walk(f"{place}.{name}", entry)
        elif value.dtype == object:
            for entry in value.flat:
                walk(place, entry)
        elif value.dtype.kind in "iu":
            odd.append(f"{place}: {value.dtype}")

    for name, value in contents.items():
        if not name.startswith("__"):
            walk(name, value)
    return Result("types", "failed" if odd else "passed", "; ".join(odd[:5]) or "every number a double")


if __name__ == "__main__":
    run_checks([parameters, recording, types])
