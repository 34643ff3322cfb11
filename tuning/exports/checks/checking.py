"""What every check shares: the golden recording, how far an answer lies from it, and how results are told."""

import csv
import json
import math
import statistics
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

HERE = Path(sys.argv[sys.argv.index("--folder") + 1]) if "--folder" in sys.argv else Path(__file__).parent
"""The exported folder: where this lies, or what ``--folder`` names."""
TOLERANCE = 1e-9
"""Largest deviation from the golden recording."""


class Result(NamedTuple):
    """What one check found.

    Args:
        name: of the check.
        state: "passed", "failed", or "skipped" where this machine lacks something.
        what: for people.
        figures: numbers.
    """

    name: str
    state: str
    what: str
    figures: Mapping[str, Any] = MappingProxyType({})


class Golden(NamedTuple):
    """The golden recording: `time`, inputs and outputs by name."""

    time: list[float]
    inputs: dict[str, list[float]]
    outputs: dict[str, list[float]]


def read_golden(path: Path = HERE / "golden.csv") -> Golden:
    """Return the golden recording; the outputs' columns begin with ``out.``."""
    with path.open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    columns = {name: [float(row[i]) for row in rows] for i, name in enumerate(header)}
    time = columns.pop("time")
    outputs = {name.removeprefix("out."): columns.pop(name) for name in header if name.startswith("out.")}
    return Golden(time, columns, outputs)


def as_arrays(columns: Mapping[str, Sequence[float]], signals: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the arrays of signals, `(time, ...)`, from columns of their numbers; needs numpy.

    Args:
        columns: by the numbers' names, e.g. ``stiffness[0][2]``.
        signals: name and shape, as in the manifest.
    """
    import numpy as np

    arrays = {}
    for signal in signals:
        names = [signal["name"] + _index(index) for index in np.ndindex(*signal["shape"])]
        arrays[signal["name"]] = np.stack([columns[name] for name in names], axis=-1).reshape(-1, *signal["shape"])
    return arrays


def as_columns(arrays: Mapping[str, Any]) -> dict[str, list[float]]:
    """Return every number of some arrays, `(time, ...)`, by its name; needs numpy."""
    import numpy as np

    columns = {}
    for name, array in arrays.items():
        values = np.asarray(array, float)
        for index in np.ndindex(*values.shape[1:]):
            columns[name + _index(index)] = values[(slice(None), *index)].tolist()
    return columns


def _index(index: Iterable[int]) -> str:
    return "".join(f"[{i}]" for i in index)


def deviation(answers: Sequence[float], recorded: Sequence[float]) -> float:
    """Return the largest |answer − recorded| / max(|recorded|, typical magnitude), the median one."""
    if len(answers) != len(recorded):
        return math.inf
    finite = [abs(value) for value in recorded if math.isfinite(value)]
    typical = statistics.median_high(finite) if finite else 0.0
    worst = 0.0
    for answer, value in zip(answers, recorded, strict=True):
        if answer == value or (math.isnan(answer) and math.isnan(value)):
            continue
        if not (math.isfinite(answer) and math.isfinite(value)):
            return math.inf
        worst = max(worst, abs(answer - value) / max(abs(value), typical, sys.float_info.min))
    return worst


def compare(
    name: str, what: str, answers: Mapping[str, Sequence[float]], recorded: Mapping[str, Sequence[float]]
) -> Result:
    """Return whether all answers lie within the tolerance of the recorded ones."""
    found = {key: deviation(answers.get(key, ()), values) for key, values in recorded.items()}
    worst = max(found, key=lambda key: found[key])
    state = "passed" if found[worst] <= TOLERANCE else "failed"
    told = f"{what}: largest deviation {found[worst]:.2g} ({worst}), allowed {TOLERANCE:g}"
    return Result(name, state, told, {"deviation": found, "tolerance": TOLERANCE})


class Unreadable(Exception):
    """What was exported cannot be read here; the text says why, and the way out."""


PACKAGES = MappingProxyType({"yaml": "pyyaml", "tuning": "'vsajax[export]'", "vsajax": "'vsajax[export]'"})
"""What installs a module that is called otherwise."""


def run_checks(checks: Iterable[Callable[[], Result | list[Result]]]) -> None:
    """Run checks, print what they found, write it to a file after ``--json``.

    Exits with 1 where one failed, or where none passed: what could not be looked at does not hold.

    Args:
        checks: functions; a package that is missing skips the check.
    """
    results: list[Result] = []
    for check in checks:
        try:
            found = check()
        except ImportError as error:
            found = Result(check.__name__, "skipped", _lacking(error))
        except Unreadable as error:
            found = Result(check.__name__, "failed", str(error))
        results += found if isinstance(found, list) else [found]
    if not any(result.state == "passed" for result in results):
        results = [result._replace(state="failed") for result in results]
    for result in results:
        print(f"{result.state:8} {result.name}: {result.what}")
    if "--json" in sys.argv:
        path = Path(sys.argv[sys.argv.index("--json") + 1])
        path.write_text(
            json.dumps([{**result._asdict(), "figures": dict(result.figures)} for result in results]),
            encoding="utf-8",
        )
    sys.exit(1 if any(result.state == "failed" for result in results) else 0)


def _lacking(error: ImportError) -> str:
    name = (error.name or "").partition(".")[0]
    if not isinstance(error, ModuleNotFoundError) or not name:
        return str(error)
    return f"{name} is not installed: pip install {PACKAGES.get(name, name)}"
