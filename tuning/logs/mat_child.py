"""Reads a MATLAB file of version 4 to 7 in a process of its own: SciPy's parser crashes on some damaged ones.

Run as ``python -m tuning.logs.mat_child FILE OUTPUT``: writes the arrays of numbers to OUTPUT, an npz archive.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat

from tuning.logs.formats import split_matrix

_MOST_ELEMENTS = 64


def read(path: Path) -> dict[str, np.ndarray]:
    """Return the numeric arrays, and the numeric fields of structs, by MATLAB's names."""
    found: dict[str, np.ndarray] = {}
    for name, value in loadmat(path, squeeze_me=True, struct_as_record=False).items():
        # "None" is where SciPy puts MATLAB's objects, which it cannot read.
        if not name.startswith("__") and name != "None":
            _flatten(name, value, found)
    return found


def column_name(number: int, is_wide: bool) -> str:
    """Return what follows a matrix' name for one of its signals, counted from 0."""
    return f"({number + 1},:)" if is_wide else f"(:,{number + 1})"


def _flatten(name: str, value: Any, found: dict[str, np.ndarray]) -> None:
    if hasattr(value, "_fieldnames"):
        for field in value._fieldnames:
            _flatten(f"{name}.{field}", getattr(value, field), found)
    elif isinstance(value, np.ndarray) and value.dtype != object:
        found.update(split_matrix(value, name, column_name))
    elif isinstance(value, np.ndarray) and value.ndim == 1 and value.size <= _MOST_ELEMENTS:
        for number, element in enumerate(value, 1):
            _flatten(f"{name}({number})", element, found)


if __name__ == "__main__":
    try:
        columns = read(Path(sys.argv[1]))
    # Whatever a damaged file makes the parser say, the caller passes on.
    except Exception as error:
        sys.exit(str(error).splitlines()[0] if str(error) else type(error).__name__)
    np.savez(sys.argv[2], allow_pickle=False, **columns)
