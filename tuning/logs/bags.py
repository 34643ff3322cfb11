"""ROS bags: rosbag2 folders, MCAP and SQLite files, and ROS 1 bags; a topic is a table, a message a row.

A field is ``/joint_states/effort[2]``, or ``/joint_states/effort[elbow]`` where the message names its elements.
Every topic has ``/topic/received`` and, where its messages have a header, ``/topic/header.stamp``: integers in ns.
Where messages of several publishers came on one topic, ``/topic/publisher`` tells them apart: a ROS 1 bag has
their names, others are told by the frame, the elements and the fields that they fill.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from tuning.files.errors import input_error
from tuning.logs.columns import LogFile
from tuning.logs.formats import WIDEST

_RECEIVED, _STAMP, _PUBLISHER = "received", "header.stamp", "publisher"
_ZSTD = b"\x28\xb5\x2f\xfd"

Row = dict[str, Any]


def read(path: Path) -> list[LogFile]:
    """Return a table for each topic whose messages hold numbers.

    Raises:
        InputError: a folder holds no bag, messages are compressed one by one, or no topic's type is known.
    """
    files, notes = _files(path)
    topics: dict[str, list[Row]] = {}
    # Bags older than Iron carry no message definitions.
    with AnyReader(files, default_typestore=get_typestore(Stores.LATEST)) as reader:
        known = [c for c in reader.connections if c.msgtype in reader.typestore.fielddefs]
        unread = {c.topic: c.msgtype for c in reader.connections if c not in known}
        callers: dict[str, set[str]] = {}
        for connection in known:
            callers.setdefault(connection.topic, set()).add(_caller(connection))
        for connection, received, raw in reader.messages(connections=known) if known else ():
            if raw[:4] == _ZSTD:
                raise _compressed(path)
            message = reader.deserialize(raw, connection.msgtype)
            several = len(callers[connection.topic]) > 1
            row: Row = {_RECEIVED: received, _PUBLISHER: _caller(connection) if several else _layout_of(message)}
            _flatten("", message, row)
            topics.setdefault(connection.topic, []).append(row)
    if unread and not topics:
        said = ", ".join(f"{topic} ({msgtype})" for topic, msgtype in unread.items())
        raise input_error(
            path,
            f"has no topic whose type is known: {said}; the bag lacks their definitions",
            "record to MCAP, which keeps them, or convert it where the package is built: ros2 bag convert",
        )
    return [_table(path, topic, rows, notes, unread) for topic, rows in topics.items()]


def _files(path: Path) -> tuple[list[Path], tuple[str, ...]]:
    """Return what to open: a file, a folder, or the files of a folder without metadata."""
    if not path.is_dir() or (path / "metadata.yaml").is_file():
        return [path], ()
    files = sorted(file for file in path.iterdir() if file.suffix in (".mcap", ".db3"))
    if len({file.suffix for file in files}) != 1:
        raise input_error(path, "is a directory without a bag", "name a file in it")
    names = ", ".join(file.name for file in files)
    return files, (f"the folder has no metadata.yaml: {names} read in the order of time",)


def _compressed(path: Path) -> Exception:
    folder = path if path.is_dir() else path.parent
    if (folder / "metadata.yaml").is_file():
        fix = f"give the folder: {folder}"
    else:
        fix = f"give its folder with metadata.yaml; where that is lost: ros2 bag reindex {folder}"
    return input_error(path, "holds messages compressed one by one (zstd), as only metadata.yaml says", fix)


def _caller(connection: Any) -> str:
    """Return who published on a connection, as far as the bag says."""
    return str(getattr(connection.ext, "callerid", None) or "")


def _layout_of(message: Any) -> str:
    """Return what tells a message with named elements from others: its frame, elements and filled fields."""
    labels = getattr(message, "name", None)
    if not isinstance(labels, list):
        return ""
    frame = getattr(getattr(message, "header", None), "frame_id", "")
    arrays = {f: getattr(message, f) for f in getattr(message, "__dataclass_fields__", {}) if f != "name"}
    filled = [field for field, value in arrays.items() if isinstance(value, np.ndarray) and value.size]
    return (f"{frame}: " if frame else "") + f"{' '.join(map(str, labels))}; {' '.join(filled)}"


def _table(path: Path, topic: str, rows: list[Row], notes: tuple[str, ...], unread: dict[str, str]) -> LogFile:
    fields = dict.fromkeys(name for row in rows for name in row)
    told_apart = len({row[_PUBLISHER] for row in rows}) > 1
    if not told_apart:
        fields.pop(_PUBLISHER)
    table = pa.table({f"{topic}/{field}": pa.array([row.get(field) for row in rows]) for field in fields})
    stamp = _STAMP if _STAMP in fields and any(row.get(_STAMP) for row in rows) else _RECEIVED
    return LogFile(
        path,
        tuple(table.column_names),
        table,
        f"{topic}/{stamp}",
        notes=notes,
        row_name="message",
        publisher=f"{topic}/{_PUBLISHER}" if told_apart else None,
        unread=unread,
    )


def _flatten(prefix: str, message: Any, row: Row) -> None:
    labels = getattr(message, "name", None)
    for field in getattr(message, "__dataclass_fields__", {}):
        if field.startswith("__"):
            continue
        value, name = getattr(message, field), f"{prefix}{field}"
        if hasattr(value, "sec") and hasattr(value, "nanosec"):
            row[name] = int(value.sec) * 1_000_000_000 + int(value.nanosec)
        elif isinstance(value, bool | int | float | np.number):
            row[name] = float(value) if isinstance(value, float | np.floating) else int(value)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
            if value.size <= WIDEST:
                own = labels if isinstance(labels, list) and len(labels) == value.size else range(value.size)
                for label, element in zip(own, value.tolist(), strict=True):
                    row[f"{name}[{label}]"] = element
        elif isinstance(value, list):
            for i, element in enumerate(value[:WIDEST]):
                _flatten(f"{name}[{i}].", element, row)
        elif hasattr(value, "__dataclass_fields__"):
            _flatten(f"{name}.", value, row)
