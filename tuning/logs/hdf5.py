"""HDF5 files, of any writer: datasets by path, matrices by column, compound types by field."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa

from tuning.logs.files import LogFile
from tuning.logs.formats import group_by_length, split_matrix


def read(path: Path) -> list[LogFile]:
    """Return the datasets of numbers or text: ``group/name``, ``group/name[:,1]``, ``group/name.field``."""
    columns: dict[str, Any] = {}
    with h5py.File(path) as file:

        def visit(name: str, item: Any) -> None:
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


def _column(number: int, is_wide: bool) -> str:
    return f"[{number},:]" if is_wide else f"[:,{number}]"
