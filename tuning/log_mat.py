"""MATLAB files: v4 to v7 through SciPy, v7.3 through h5py, both under MATLAB's own names.

A column of a matrix is ``name(:,2)``, counted from 1, of a struct ``log.speed``; Simulink's "structure with time"
becomes ``out.time`` and ``out.signals.values``.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tuning.errors import input_error
from tuning.log_files import LogFile
from tuning.log_formats import group_by_length, split_matrix

_HDF5 = b"\x89HDF\r\n\x1a\n"


def read(path: Path) -> list[LogFile]:
    """Return the numeric arrays and the numeric fields of structs."""
    with path.open("rb") as file:
        start = file.read(2048)
    # MATLAB puts 512 bytes of text before the HDF5 file.
    columns = _read_hdf5(path) if _HDF5 in start else _read_binary(path)
    return group_by_length(path, columns)


def _read_binary(path: Path) -> dict[str, np.ndarray]:
    from scipy.io import loadmat

    found: dict[str, np.ndarray] = {}
    variables = loadmat(path, squeeze_me=True, struct_as_record=False)
    opaque = "None" in variables or "__function_workspace__" in variables
    for name, value in variables.items():
        if not name.startswith("__") and name != "None":
            _flatten(name, value, found)
    if opaque and not found:
        raise input_error(
            path,
            "holds MATLAB objects only, such as timeseries or tables, which no other program reads",
            "in MATLAB: log.time = ts.Time; log.speed = ts.Data; save('log.mat', 'log')",
        )
    return found


def _flatten(name: str, value: Any, found: dict[str, np.ndarray]) -> None:
    if hasattr(value, "_fieldnames"):
        for field in value._fieldnames:
            _flatten(f"{name}.{field}", getattr(value, field), found)
    elif isinstance(value, np.ndarray) and value.dtype != object:
        found.update(split_matrix(value, name, _column))
    elif isinstance(value, np.ndarray) and value.ndim == 1 and value.size <= 64:
        for number, element in enumerate(value, 1):
            _flatten(f"{name}({number})", element, found)


def _read_hdf5(path: Path) -> dict[str, np.ndarray]:
    import h5py

    found: dict[str, np.ndarray] = {}

    def walk(prefix: str, group: Mapping[str, Any]) -> None:
        for name, item in group.items():
            if name.startswith("#"):
                continue
            if isinstance(item, h5py.Group):
                walk(f"{prefix}{name}.", item)
            elif (
                isinstance(item, h5py.Dataset)
                and item.dtype.kind in "fiub"
                and item.attrs.get("MATLAB_class", b"double") not in (b"char", b"cell")
                and not item.attrs.get("MATLAB_empty", 0)
            ):
                # HDF5 has MATLAB's columns as rows.
                found.update(split_matrix(np.asarray(item[...]).T, f"{prefix}{name}", _column))

    with h5py.File(path) as file:
        walk("", file)
    return found


def _column(number: int, is_wide: bool) -> str:
    return f"({number + 1},:)" if is_wide else f"(:,{number + 1})"
