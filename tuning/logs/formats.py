"""Every format a log may come in, behind one function: the columns of a file, grouped by the rows they share."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa

from tuning.files.errors import InputError, input_error
from tuning.logs.columns import READ_SUFFIXES as TABLE_SUFFIXES
from tuning.logs.columns import LogFile, check_readable, read_log_file
from tuning.logs.layout import AS_FOUND, FileFormat
from tuning.logs.rows import split_rows

WIDEST = 64
"""Columns up to which a matrix counts as signals."""

Columns = Mapping[str, np.ndarray | pa.Array]

_READERS = {
    ".mat": "tuning.logs.mat",
    ".h5": "tuning.logs.hdf5",
    ".hdf5": "tuning.logs.hdf5",
    ".bag": "tuning.logs.bags",
    ".mcap": "tuning.logs.bags",
    ".db3": "tuning.logs.bags",
}
SUFFIXES = (*TABLE_SUFFIXES, *_READERS)


def read_streams(path: Path, told: FileFormat = AS_FOUND) -> list[LogFile]:
    """Return the columns of a log, as one `LogFile` for those that share their rows.

    CSV and Parquet have one such group, MAT and HDF5 one for each length, a bag one for each topic.

    Args:
        path: the file, or the folder of a bag.
        told: how a text file is laid out, as far as it is known.

    Raises:
        InputError: the file is missing, empty, unreadable, cut short, of an unknown format, or holds no numbers;
            or the package that reads its format is not installed.
    """
    suffix = path.suffix.lower()
    if path.is_dir() and _is_bag(path):
        suffix = ".mcap"
    if suffix in (".zstd", ".zst") and Path(path.stem).suffix in (".mcap", ".db3"):
        raise input_error(path, "is compressed, as only metadata.yaml says", f"give the folder: {path.parent}")
    if suffix not in _READERS:
        if suffix not in TABLE_SUFFIXES and not path.is_dir():
            known = ", ".join(SUFFIXES)
            raise input_error(path, f"unknown suffix {suffix!r}; known are {known}", "convert it to one of them")
        return split_rows(read_log_file(path, told), told)
    if not path.is_dir():
        check_readable(path)
    try:
        read: Callable[[Path], list[LogFile]] = importlib.import_module(_READERS[suffix]).read
        streams = read(path)
    except InputError:
        raise
    except ImportError as error:
        package = (error.name or "").partition(".")[0]
        raise input_error(
            path, f"needs the package {package} to be read", "install it: pip install 'vsajax[logs]'"
        ) from None
    # A damaged file may make its parser fail anyhow; none of it is the user's to read.
    except Exception as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise input_error(
            path, f"cannot be read as a {suffix} file: {reason}", "was it cut short or misnamed?"
        ) from None
    if not streams:
        raise input_error(
            path, "holds no signals: no column of numbers", f"columns and up to {WIDEST} wide matrices"
        )
    return streams


def _is_bag(folder: Path) -> bool:
    return any(file.name == "metadata.yaml" or file.suffix in (".mcap", ".db3") for file in folder.iterdir())


def group_by_length(path: Path, columns: Columns) -> list[LogFile]:
    """Return columns as one `LogFile` for each length of at least 2."""
    groups: dict[int, dict[str, pa.Array]] = {}
    for name, values in columns.items():
        if len(values) > 1:
            groups.setdefault(len(values), {})[name] = pa.array(values)
    return [LogFile(path, tuple(group), pa.table(group)) for group in groups.values()]


def split_matrix(values: np.ndarray, name: str, column: Callable[[int, bool], str]) -> dict[str, np.ndarray]:
    """Return the signals of an array of numbers by name; none where it cannot be signals.

    Args:
        values: of up to two dimensions; the longer one is time.
        name: of a vector.
        column: (number from 0, whether signals are rows) -> what follows the name of a matrix.
    """
    values = np.squeeze(values)
    if values.dtype.kind not in "fiub" or values.ndim not in (1, 2):
        return {}
    if values.ndim == 1:
        return {name: values}
    is_wide = values.shape[1] > values.shape[0]
    signals = values if is_wide else values.T
    if len(signals) > WIDEST:
        return {}
    return {f"{name}{column(i, is_wide)}": np.ascontiguousarray(row) for i, row in enumerate(signals)}


def names_of(streams: Sequence[LogFile]) -> list[str]:
    """Return the names of all columns."""
    return [name for stream in streams for name in stream.names]
