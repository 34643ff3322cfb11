"""MATLAB files: v4 to v7 through SciPy, v7.3 through h5py, both under MATLAB's own names.

A column of a matrix is ``name(:,2)``, counted from 1, of a struct ``log.speed``; Simulink's "structure with time"
becomes ``out.time`` and ``out.signals.values``.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tuning.files.errors import input_error
from tuning.logs.columns import LogFile
from tuning.logs.formats import group_by_length, split_matrix

_HDF5 = b"\x89HDF\r\n\x1a\n"


def read(path: Path) -> list[LogFile]:
    """Return the numeric arrays and the numeric fields of structs."""
    with path.open("rb") as file:
        start = file.read(2048)
    # MATLAB puts 512 bytes of text before the HDF5 file.
    columns = _read_hdf5(path) if _HDF5 in start else _read_binary(path)
    if not columns:
        raise input_error(
            path,
            "holds no arrays of numbers; timeseries, tables and other objects only MATLAB itself reads",
            "in MATLAB: log.time = ts.Time; log.speed = ts.Data; save('log.mat', 'log')",
        )
    return group_by_length(path, columns)


def _read_binary(path: Path) -> dict[str, np.ndarray]:
    with tempfile.TemporaryDirectory() as folder:
        archive = Path(folder) / "columns.npz"
        command = [sys.executable, "-m", "tuning.logs.mat_child", str(path.resolve()), str(archive)]
        # The package itself may be a checkout that only this process has on its path.
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        ended = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
        if ended.returncode:
            said = ended.stderr.strip().splitlines()
            crashed = ended.returncode < 0 or not said
            raise ValueError("its parser crashed" if crashed else said[-1])
        with np.load(archive) as columns:
            return {name: columns[name] for name in columns.files}


def _read_hdf5(path: Path) -> dict[str, np.ndarray]:
    import h5py

    from tuning.logs.hdf5 import name_of
    from tuning.logs.mat_child import column_name

    found: dict[str, np.ndarray] = {}

    def walk(prefix: str, group: Mapping[str, Any]) -> None:
        for found_name, item in group.items():
            name = name_of(path, found_name)
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
                found.update(split_matrix(np.asarray(item[...]).T, f"{prefix}{name}", column_name))

    with h5py.File(path) as file:
        walk("", file)
    return found
