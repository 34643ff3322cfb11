"""What a finished run folder says: its study, its scores by scenario, and the estimators it stands for."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from tuning.files.errors import InputError, input_error
from tuning.files.seal import SEALED, breaks_seal
from tuning.problem.calibration import is_band
from tuning.problem.interface import Status, Stream, problem_of
from tuning.runs.folder import read_results
from tuning.runs.manifest import read_manifest
from tuning.runs.sealed import columns_of, is_file, read_table
from tuning.scoring.comparison import contenders
from tuning.scoring.grid import Grid
from tuning.scoring.montecarlo import MonteCarlo
from tuning.scoring.summary import Columns, Influence, Interval, Summary, summarise
from tuning.scoring.sweep import GridSweep, Value, rank
from tuning.study.base import Study, resolved, study_hash
from tuning.study.inputs import check_inputs
from tuning.study.kinds import Ref, all_kinds
from tuning.study.loading import load_config, parse_study, with_numbers
from tuning.study.paths import numeric_paths
from tuning.study.scores import SCORES

COMMANDS = ("montecarlo", "sweep", "tune", "compare", "contest")
_WORST = 5
_PLANS = {"sweep": ("axes", "scenarios", "points_per_chunk"), "montecarlo": ("scenarios",)}
"""What a report needs of a plan."""


@dataclass(frozen=True)
class Contestant:
    """An estimator that a run has scored.

    Args:
        name: its label.
        study: the study with this estimator and its numbers; `None` where the run does not hold it.
        scores: `(scenario,)` by metric; NaN in a scenario without scores.
    """

    name: str
    study: Study | None
    scores: Columns


@dataclass(frozen=True)
class FinishedRun:
    """A finished run.

    Args:
        folder: its folder.
        manifest: its manifest.
        study: what it ran on.
    """

    folder: Path
    manifest: Mapping[str, Any]
    study: Study

    @property
    def command(self) -> str:
        """The command that ran."""
        return self.manifest["command"]

    @property
    def objective(self) -> str:
        """The metric that the run is about."""
        return self.study.tune.objective

    @property
    def stream(self) -> Stream:
        """The scenarios on which the report shows traces."""
        return "population" if self.command == "montecarlo" else "held_out"

    @property
    def scored(self) -> Path:
        """The folder of the scores: a contest's are those of the comparison that ends it."""
        return self.folder / "compare" if self.command == "contest" else self.folder

    @cached_property
    def compared(self) -> dict[str, str]:
        """The study hash of every configuration of a comparison or a contest by its file, in order."""
        return (
            self.manifest["plan"]
            if self.command == "compare"
            else read_manifest(self.scored / "manifest.json")["plan"]
        )

    @cached_property
    def columns(self) -> dict[str, np.ndarray]:
        """The columns of the run's results."""
        return columns_of(read_results(self.scored))

    @cached_property
    def summary(self) -> Summary:
        """What a Monte Carlo run says: as it was written, or computed again where it is missing."""
        path = self.folder / "summary.json"
        if is_file(path):
            return _read_summary(path, needs_seal=SEALED in self.manifest)
        beside = self.folder / "design"
        design = columns_of(read_results(beside)) if (beside / "results.parquet").exists() else None
        factors = MonteCarlo(self.study, self.columns["status"].size).factors
        study, objective = self.study, self.objective
        return summarise(
            self.columns,
            design,
            study.population,
            factors,
            objective,
            _WORST,
            seed=study.seed,
            numbers=numeric_paths(study),
        )

    @cached_property
    def axes(self) -> dict[str, list[Value]]:
        """The axes of a sweep."""
        return {path: list(values) for path, values in self.manifest["plan"]["axes"].items()}

    @cached_property
    def ranking(self) -> list[dict[str, Any]]:
        """The configurations of a sweep, best first."""
        return rank(read_results(self.folder), list(self.axes), self.objective)

    @cached_property
    def contestants(self) -> list[Contestant]:
        """What was scored: the population, a sweep's best, a study before and after tuning, or all compared."""
        return _CONTESTANTS[self.command](self)

    @cached_property
    def best(self) -> Contestant:
        """The contestant with the lowest objective; of a search, what it found."""
        if self.command not in {"compare", "contest"}:
            return self.contestants[-1]
        statistic = self.study.tune.statistic

        def value(one: Contestant) -> float:
            scores = one.scores[self.objective]
            finite = scores[np.isfinite(scores)]
            return float(statistic.of(finite)) if finite.size else np.inf

        return min(self.contestants, key=value)


def own_page(folder: Path) -> Ref | None:
    """Return what reports on a run of a kind's own command; `None` of a run that any kind can have."""
    try:
        tables = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    name = tables.get("kind") if isinstance(tables, dict) else None
    return next((kind.page for kind in all_kinds() if kind.name == name), None)


def open_finished(folder: Path) -> FinishedRun:
    """Return a finished run.

    Raises:
        InputError: the folder holds no run, or one that is not finished.
    """
    where = f"name a folder that {', '.join(COMMANDS[:-1])} or {COMMANDS[-1]} has written (-o)"
    path = folder / "manifest.json"
    if not folder.is_dir():
        raise input_error(folder, "is no folder" if folder.exists() else "no such folder", where)
    if not path.exists():
        raise input_error(folder, "is no run folder: it holds no manifest.json", where)
    if (folder / "golden.csv").is_file():
        raise input_error(folder, "holds an export, not a run", f"vsajax export {folder} --check, or {where}")
    manifest = read_manifest(path)
    command, study, plan = manifest["command"], manifest["study"], manifest["plan"]
    if command not in COMMANDS:
        raise input_error(folder, f"holds a run of {command!r}", where)
    lacking = [key for key in _PLANS.get(command, ()) if key not in plan]
    if lacking:
        raise input_error(f"{path}: plan", f"lacks {', '.join(lacking)}", where)
    if command == "montecarlo" and plan.get("rows"):
        raise input_error(folder, "holds the design of a run, not the run", f"name {folder.resolve().parent}")
    run = FinishedRun(folder, manifest, parse_study(study, f"{path}: study"))
    missing = _missing(run)
    check_inputs(manifest.get("files", {}), run.study, folder)
    if missing:
        fix = f"go on with vsajax {command} and the same options, with --resume"
        raise input_error(folder, f"holds an unfinished run: {missing}", fix)
    return run


def check_comparable(first: FinishedRun, second: FinishedRun) -> None:
    """Check that two runs can be reported on together.

    Raises:
        InputError: they are one, or of different commands.
    """
    if first.folder.resolve() == second.folder.resolve():
        raise input_error(second.folder, "is named twice", "name another run, or this one alone")
    if first.command != second.command:
        raise input_error(
            second.folder,
            f"holds a run of {second.command}, but {first.folder} one of {first.command}",
            "report on two runs of one command, or on each by itself",
        )


def is_paired(first: FinishedRun, second: FinishedRun) -> bool:
    """Return whether scenario i is the same robot with the same noise in both runs."""
    return (
        first.command == second.command
        and first.study.seed == second.study.seed
        and first.study.population == second.study.population
    )


def _missing(run: FinishedRun) -> str:
    results = run.scored / "results.parquet"
    if not is_file(results):
        return "it has no results.parquet"
    if run.command == "tune" and not is_file(run.folder / "best.toml"):
        return "it has no best.toml"
    # One that was to stop at some precision is joined before it is done, but summed up only then.
    is_whole = run.command != "montecarlo" or is_file(run.folder / "summary.json")
    if not is_whole and read_table(results).num_rows < run.manifest["plan"]["scenarios"]:
        return "some of its scenarios are missing"
    return ""


def _metrics(columns: Columns, rows: np.ndarray) -> dict[str, np.ndarray]:
    return {name: columns[name][rows] for name in SCORES if name in columns}


def _population(run: FinishedRun) -> list[Contestant]:
    counted = run.columns["status"] == Status.OK
    every = np.arange(counted.size)
    scores = {name: np.where(counted, v, np.nan) for name, v in _metrics(run.columns, every).items()}
    return [Contestant(run.study.name, run.study, scores)]


def _swept(run: FinishedRun) -> list[Contestant]:
    first = run.ranking[0]
    rows = np.flatnonzero(run.columns["configuration"] == first["configuration"])
    rows = rows[np.argsort(run.columns["scenario"][rows])]
    sweep = GridSweep.from_plan(run.study, run.manifest["plan"])
    study = sweep.study_of(first["configuration"], f"{run.folder}: best configuration")
    return [Contestant("best configuration", study, _metrics(run.columns, rows))]


def _tuned(run: FinishedRun) -> list[Contestant]:
    studies = {"before": run.study, "tuned": load_best(run)}
    return [Contestant(name, study, _score(study)) for name, study in studies.items()]


def load_best(run: FinishedRun) -> Study:
    """Return the study that a search has found.

    Raises:
        InputError: `best.toml` cannot be read, or has been changed: its numbers are none that the search tried, or
            it differs from the study in more than them.
    """
    path = run.folder / "best.toml"
    held = load_config(path)
    # What is deployed of some studies is the estimator alone.
    is_whole = isinstance(held, Study)
    best = held if is_whole else parse_study(resolved(run.study) | resolved(held), str(path))
    tuned = [name for name in run.study.tune.parameters if name in best.provenance.get("tuned", [])]
    values = numeric_paths(best)
    is_it = np.ones(run.columns["objective"].size, bool)
    for name in tuned:
        is_it &= run.columns[name] == values.get(name)
    # A choice changes more than numbers, and which there are.
    if not run.study.tune.choices:
        own = numeric_paths(run.study)
        calibrated = [name for name in best.provenance.get("calibrated", []) if is_band(name) and name in own]
        before = with_numbers(best, {name: own[name] for name in [*tuned, *calibrated]}, str(path))
        is_it &= study_hash(before) == run.manifest["study_hash"]
    if not is_it.any():
        raise input_error(path, "is not what this search has found: it was changed", "--resume writes it again")
    return best


def _score(study: Study) -> dict[str, np.ndarray]:
    """Score a study on its held-out scenarios again: a search keeps only their statistics."""
    scores = Grid(problem_of(study), {}, study.scenarios.held_out, "held_out").evaluate(np.empty((1, 0)))
    return _metrics({name: score[0, 0] for name, score in scores.items()}, np.arange(study.scenarios.held_out))


def _compared(run: FinishedRun) -> list[Contestant]:
    names = list(run.compared)
    shown = [Path(name).parent.name for name in names] if run.command == "contest" else short_names(names)
    found = []
    for place, name in enumerate(names):
        rows = np.flatnonzero(run.columns["configuration"] == name)
        is_own = run.command == "compare" and place == 0
        study = run.study if is_own else _load_contender(run, name)
        found.append(Contestant(shown[place], study, _metrics(run.columns, rows)))
    return found


def _load_contender(run: FinishedRun, name: str) -> Study | None:
    """Return a contender from its file, if that is still what was compared."""
    try:
        study = contenders({name: load_config(contender_file(run, name))}, run.study, str(run.folder))[name]
    except InputError:
        return None
    return study if study_hash(study) == run.compared[name] else None


def contender_file(run: FinishedRun, name: str) -> Path:
    """Return the file of a compared configuration: a contest's lie in its folder, wherever that was moved to."""
    return run.folder / Path(name).parent.name / "best.toml" if run.command == "contest" else Path(name)


_CONTESTANTS = {
    "montecarlo": _population,
    "sweep": _swept,
    "tune": _tuned,
    "compare": _compared,
    "contest": _compared,
}


def short_names(names: list[str]) -> list[str]:
    """Return the shortest ends of some file or folder names that tell them apart."""
    parts = [Path(name).parts for name in names]
    for size in range(1, max(map(len, parts)) + 1):
        found = [str(Path(*each[-size:])) for each in parts]
        if len(set(found)) == len(found):
            return found
    return names


def _read_summary(path: Path, *, needs_seal: bool) -> Summary:
    """Return a written summary; numbers that JSON lacks are text there."""

    def interval(table: Mapping[str, Any]) -> Interval:
        return Interval(**{name: float(value) for name, value in table.items()})

    try:
        tables = json.loads(path.read_text(encoding="utf-8"))
        if (needs_seal or SEALED in tables) and breaks_seal(tables):
            raise ValueError("it does not hold what was written")
        tables.pop(SEALED, None)
        return Summary(
            **tables
            | {
                "remedies": [],
                "quantiles": {
                    metric: {float(level): interval(q) for level, q in levels.items()}
                    for metric, levels in tables["quantiles"].items()
                },
                "failures": {name: interval(p) for name, p in tables["failures"].items()},
                "correlations": {name: interval(c) for name, c in tables["correlations"].items()},
                "influences": {
                    name: Influence(interval(i["first"]), interval(i["total"]))
                    for name, i in tables["influences"].items()
                },
            }
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise input_error(path, f"cannot be read ({error})", "--resume writes it again") from None
