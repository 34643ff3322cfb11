"""ROS bags: rosbag2 folders, MCAP and SQLite files, and ROS 1 bags; a topic is a table, a message a row.

A field is ``/joint_states/effort[2]``, or ``/joint_states/effort[elbow]`` where the message names its elements.
Every topic has ``/topic/received`` and, where its messages have a header, ``/topic/header.stamp``: integers in ns.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from tuning.logs.files import LogFile
from tuning.logs.formats import WIDEST

_RECEIVED, _STAMP = "received", "header.stamp"


def read(path: Path) -> list[LogFile]:
    """Return a table for each topic whose messages hold numbers."""
    topics: dict[str, list[dict[str, Any]]] = {}
    # Bags older than Iron carry no message definitions.
    with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
        known = [c for c in reader.connections if c.msgtype in reader.typestore.fielddefs]
        for connection, received, raw in reader.messages(connections=known) if known else ():
            row: dict[str, Any] = {_RECEIVED: received}
            _flatten("", reader.deserialize(raw, connection.msgtype), row)
            topics.setdefault(connection.topic, []).append(row)
    return [_table(path, topic, rows) for topic, rows in topics.items()]


def _table(path: Path, topic: str, rows: list[dict[str, Any]]) -> LogFile:
    fields = dict.fromkeys(name for row in rows for name in row)
    table = pa.table({f"{topic}/{field}": pa.array([row.get(field) for row in rows]) for field in fields})
    stamp = _STAMP if _STAMP in fields and any(row.get(_STAMP) for row in rows) else _RECEIVED
    return LogFile(path, tuple(table.column_names), table, f"{topic}/{stamp}")


def _flatten(prefix: str, message: Any, row: dict[str, Any]) -> None:
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
