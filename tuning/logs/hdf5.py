"""HDF5 files, of any writer: datasets by path, matrices by column, compound types by field."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa

from tuning.files.errors import input_error
from tuning.logs.columns import LogFile
from tuning.logs.formats import group_by_length, split_matrix


def read(path: Path) -> list[LogFile]:
    """Return the datasets of numbers or text: ``group/name``, ``group/name[:,1]``, ``group/name.field``.

    Raises:
        InputError: a name is not UTF-8.
    """
    columns: dict[str, Any] = {}
    with h5py.File(path) as file:

        def visit(found: str | bytes, item: Any) -> None:
            name = name_of(path, found)
            if not isinstance(item, h5py.Dataset) or item.shape is None or not 1 <= item.ndim <= 3:
                return
            if item.dtype.names:
                for field in item.dtype.names:
                    columns.update(split_matrix(item[field], f"{name}.{field}", _column))
            elif item.dtype.kind in "fiub":
                columns.update(split_matrix(item[...], name, _column))
            elif h5py.check_string_dtype(item.dtype) and item.ndim == 1:
                columns[name] = pa.array(np.asarray(item.asstr()[...]).tolist())

        file.visititems(visit)
    return group_by_length(path, columns)


def name_of(path: Path, name: str | bytes) -> str:
    """Return the name of a dataset or group.

    Raises:
        InputError: it is not UTF-8, as HDF5 wants it: h5py then has bytes.
    """
    if isinstance(name, bytes):
        shown = name.decode("utf-8", "backslashreplace")
        raise input_error(path, f'has a dataset or group "{shown}", whose name is not UTF-8', "rename it")
    return name


def _column(number: int, is_wide: bool) -> str:
    return f"[{number},:]" if is_wide else f"[:,{number}]"
