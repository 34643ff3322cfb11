"""Tables whose rows are filled by one group of columns each, as several topics written to one file are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyarrow as pa

from tuning.logs.columns import LogFile
from tuning.logs.layout import FileFormat

_OVERLAP = 0.1
"""Share of the rows of a group up to which another may fill them by chance: stamps that agree are one row."""
_FEWEST = 3
_MOST_GROUPS = 64


def split_rows(log: LogFile, told: FileFormat) -> list[LogFile]:
    """Return a table as one for each group of columns that fills rows of its own; the full columns go with each.

    Args:
        log: a table.
        told: `split_rows` decides where it is given; else only groups that hardly ever share a row are split.
    """
    if told.split_rows is False or log.table.num_rows < 2 * _FEWEST:
        return [log]
    filled = {at: _filled(column) for at, column in enumerate(log.table.columns)}
    shared = [at for at, mask in filled.items() if mask.all()]
    groups: dict[bytes, list[int]] = {}
    for at, mask in filled.items():
        if not mask.all() and mask.any():
            groups.setdefault(mask.tobytes(), []).append(at)
    places = list(groups.values())
    if told.split_rows is None:
        places = _with_those_inside(places, filled)
        if not _are_apart([filled[group[0]] for group in places]):
            return [log]
    if not shared or not 2 <= len(places) <= _MOST_GROUPS:
        return [log]
    said = " | ".join(", ".join(repr(log.names[at]) for at in group[:3]) for group in places)
    note = f"rows are filled by {len(places)} groups of columns in turn, each read alone (file.split_rows): {said}"
    return [
        _part(log, [*shared, *group], filled[group[0]], tuple(log.names[at] for at in shared), note, told)
        for group in places
    ]


def _filled(column: pa.ChunkedArray) -> np.ndarray:
    return column.is_valid().to_numpy().astype(bool) & ~column.is_null(nan_is_null=True).to_numpy().astype(bool)


def _with_those_inside(places: list[list[int]], filled: dict[int, np.ndarray]) -> list[list[int]]:
    """Return groups with the columns that fill some of their rows and no other."""
    found: list[list[int]] = []
    for group in sorted(places, key=lambda group: -int(filled[group[0]].sum())):
        mask = filled[group[0]]
        outer = next((other for other in found if not (mask & ~filled[other[0]]).any()), None)
        if outer is None:
            found.append(list(group))
        else:
            outer += group
    return sorted(found, key=min)


def _are_apart(masks: list[np.ndarray]) -> bool:
    if len(masks) > _MOST_GROUPS or any(mask.sum() < _FEWEST for mask in masks):
        return False
    return all(
        np.count_nonzero(a & b) <= _OVERLAP * min(a.sum(), b.sum()) for i, a in enumerate(masks) for b in masks[:i]
    )


def _part(
    log: LogFile, columns: list[int], rows: np.ndarray, shared: tuple[str, ...], note: str, told: FileFormat
) -> LogFile:
    columns = sorted(columns)
    names = [log.table.column_names[at] for at in columns]
    table = pa.table([log.table.column(at).filter(pa.array(rows)) for at in columns], names)
    is_told = told.split_rows is not None
    return replace(
        log,
        names=tuple(log.names[at] for at in columns),
        table=table,
        lines=None if log.lines is None else log.lines[rows],
        shared=shared,
        notes=log.notes if is_told else (*log.notes, note),
        keys=dict(log.keys) if is_told else {**log.keys, "split_rows": True},
    )
