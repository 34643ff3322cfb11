"""What a TOML file of the lab is, told by its tables, and what it is good for. Nothing here imports jax."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from tuning.files.errors import input_error

Tables = Mapping[str, Any]

ONLY_IN_STUDIES = frozenset(
    {
        *("seed", "clock", "population", "scenarios", "sweep", "tune", "substeps"),
        *("joint", "excitation", "sensing", "integration_tolerance"),
        *("plant", "impact", "controller", "sensor", "observer", "start"),
    }
)
"""Keys of a study of something simulated that an estimator alone does not have."""


_KEYS = ONLY_IN_STUDIES | {
    "schema_version",
    "kind",
    "name",
    "provenance",
    "estimator",
    "scorer",
    "select",
    "expect",
}
"""Keys by which a file that lacks what makes its kind is still taken for one of the lab's."""


@dataclass(frozen=True)
class FileKind:
    """One kind of file.

    Args:
        label: what `vsajax check` calls it.
        name: the same with its article, as it stands in a sentence.
        use: what takes it; `{file}` is its path.
        holds: whether tables are of this kind, those before it in `FILE_KINDS` apart.
    """

    label: str
    name: str
    use: str
    holds: Callable[[Tables], bool]


SIGNAL_MAP = FileKind(
    "signal map",
    "a signal map",
    "it goes beside a log: vsajax estimate LOG --map {file} -c CONFIG",
    lambda tables: "signals" in tables,
)
LOG_STUDY = FileKind(
    "study of a log",
    "a study of a log",
    "it goes with vsajax tune, sweep, compare -s or contest, e.g. vsajax tune {file} -o RUN",
    lambda tables: "recording" in tables,
)
ARM_STUDY = FileKind(
    "study",
    "a study of an arm",
    "it goes with vsajax stiffness, workspace, poses, montecarlo, sweep, tune, compare -s, contest or export",
    lambda tables: tables.get("kind") == "arm" and "estimator" not in tables,
)
STUDY = FileKind(
    "study",
    "a study of a simulated joint",
    "it goes with vsajax simulate, sweep, tune, montecarlo, compare -s, contest or export",
    lambda tables: bool(tables.keys() & ONLY_IN_STUDIES),
)
CONFIG = FileKind(
    "estimator configuration",
    "an estimator configuration",
    "it goes with vsajax estimate -c, compare or export; to simulate, give a whole study (vsajax init KIND)",
    lambda tables: "estimator" in tables,
)
JOINT = FileKind(
    "joint preset",
    "a joint preset",
    'a study names a shipped one, preset = "NAME" in [joint], or has these tables below [joint]',
    lambda tables: "kind" not in tables and "link" in tables,
)
ARM = FileKind(
    "arm preset",
    "an arm preset",
    'a study names a shipped one, preset = "NAME" in [arm], or has these tables below [arm]',
    lambda tables: "kind" not in tables and bool(tables.keys() & {"joints", "dh", "urdf"}),
)
FILE_KINDS = (SIGNAL_MAP, LOG_STUDY, ARM_STUDY, JOINT, ARM, STUDY, CONFIG)
"""In the order in which they are asked."""


def kind_of(tables: Tables) -> FileKind | None:
    """Return what kind of file tables come from; `None` where nothing of the lab is recognised."""
    return next((kind for kind in FILE_KINDS if kind.holds(tables)), None)


def require_kind(tables: Tables, place: str, *wanted: FileKind) -> None:
    """Refuse a file of another kind than is wanted: what it is, and what takes it.

    Tables of no known kind pass where one of their keys is the lab's: the others are told one by one when they are
    validated.

    Raises:
        InputError: the tables are of another kind, or nothing of the lab.
    """
    got = kind_of(tables)
    if got is None and not tables.keys() & _KEYS:
        names = ", ".join(map(repr, list(tables)[:5])) or "nothing"
        fix = "name another file; `vsajax init --list` prints what ships, to start from"
        raise input_error(place, f"is not {wanted[0].name}, nor any file of the lab: it holds {names}", fix)
    if got is None or got in wanted:
        return
    raise input_error(place, f"is {got.name}, not {wanted[0].name}", got.use.format(file=place))
