"""Looking for the best numbers of a study, and judging them on noise that the search never saw."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np

from tuning.files.errors import InputError, input_error
from tuning.files.whole import write_text
from tuning.problem.calibration import calibrate
from tuning.problem.finding import Finding, find, joined
from tuning.problem.interface import Differentiable, Problem, Scenario, Stream, problem_of
from tuning.runs.folder import open_run
from tuning.runs.manifest import versions
from tuning.scoring.grid import Grid, lane_program
from tuning.scoring.intervals import Judgement, judge
from tuning.search.descent import Algorithm
from tuning.search.least_squares import GradientTuner, Outcome
from tuning.search.space import Space
from tuning.study.base import Study, descended, study_hash, to_toml
from tuning.study.kinds import lacking
from tuning.study.loading import with_numbers
from tuning.study.paths import contested_number, numeric_paths
from tuning.terminal.progress import progress

_SHOWN = 10
"""Screened points that are told of."""
Method = Literal["gradient", "grid", "hybrid", "tpe", "cmaes", "pareto"]


@dataclass(frozen=True)
class Tuned:
    """What a search found.

    Args:
        values: the best numbers by path.
        outcomes: where each start ended.
        train: the best numbers on the training scenarios.
        held_out: the best numbers on the held-out scenarios.
        before: the study's own numbers on the held-out scenarios.
        evaluations: scored configurations: points and optimiser steps.
        seconds: that they took, compilation included.
        screened: the best of the points that were scored on the training scenarios ahead of any start, best first:
            the statistic of the objective, and the numbers by path.
        objective: statistic of the best numbers on the training scenarios, as the search found it.
        finding: what the study's kind says of them.
        calibration: what was set beside the tuned numbers so that the answers hold what they say, by path.
    """

    values: dict[str, float]
    outcomes: list[Outcome]
    train: Judgement
    held_out: Judgement
    before: Judgement
    evaluations: int = 0
    seconds: float = 0.0
    screened: list[tuple[float, dict[str, float]]] = field(default_factory=list)
    objective: float = math.nan
    finding: Finding = field(default_factory=Finding)
    calibration: Mapping[str, float] = field(default_factory=dict)

    @property
    def deployed(self) -> dict[str, float]:
        """The tuned numbers, and those of the calibration."""
        return {**self.values, **self.calibration}

    @property
    def messages(self) -> list[str]:
        """How the starts ended."""
        return [outcome.message for outcome in self.outcomes]


@dataclass(frozen=True)
class Search:
    """A search over the `[tune]` parameters of a study.

    Args:
        study: the study; its own numbers are the first start.
        method: "gradient": from the study's numbers and the best of some Sobol points; "grid": every
            combination of the bounds' points; "hybrid": the gradient, from the grid's best. The others are
            those of `blackbox`.
        algorithm: of the gradient.
    """

    study: Study
    method: Method
    algorithm: Algorithm = "levenberg-marquardt"

    @cached_property
    def space(self) -> Space:
        """The space of the tuned parameters."""
        return Space.of(self.study.tune.parameters)

    @cached_property
    def problem(self) -> Problem:
        """The study's problem."""
        return problem_of(self.study, self.paths)

    @property
    def paths(self) -> tuple[str, ...]:
        """The tuned parameters."""
        return tuple(self.study.tune.parameters)

    @cached_property
    def own(self) -> dict[str, float]:
        """The study's numbers at the tuned paths."""
        numbers = numeric_paths(self.study)
        return {path: numbers[path] for path in self.paths}

    @cached_property
    def scenarios(self) -> Scenario:
        """The training scenarios."""
        return self.problem.scenarios("train", self.study.scenarios.train)

    @cached_property
    def tuner(self) -> GradientTuner:
        """The gradient tuner on the training scenarios."""
        assert isinstance(self.problem, Differentiable)
        return GradientTuner(self.problem, self.space, self.scenarios, self.algorithm, self.study.tune.max_steps)

    @cached_property
    def program(self) -> Any:
        """The compiled program that scores points on the training scenarios."""
        return lane_program(self.problem, self.paths, (), width=self.study.scenarios.train)

    def score(self, points: np.ndarray) -> Any:
        """Return `(point, scenario)` training scores at `(point, parameter)` numbers."""
        scenarios = jax.tree.map(lambda x: jnp.broadcast_to(x, (len(points), *x.shape)), self.scenarios)
        return self.program((jnp.asarray(points), (), scenarios), self.problem.given)

    def screen(self, points: np.ndarray) -> np.ndarray:
        """Return the statistic of the training objective at `(point, parameter)` numbers [%]."""
        scores = self.score(points)
        return self.study.tune.statistic.of(np.asarray(getattr(scores, self.study.tune.objective)))

    def sobol_points(self) -> np.ndarray:
        """Return `screen` scrambled Sobol points of the space, `(point, parameter)`."""
        count = max(self.study.tune.screen, self.study.tune.starts)
        shares = self.space.sobol_shares(count, self.study.seed)
        return self._numbers(jax.vmap(self.space.at_share)(jnp.asarray(shares)))

    def grid_points(self) -> np.ndarray:
        """Return every combination of the bounds' points, `(point, parameter)`."""
        axes = [bounds.grid() for bounds in self.study.tune.parameters.values()]
        return np.stack([axis.reshape(-1) for axis in np.meshgrid(*axes, indexing="ij")], axis=1)

    def _numbers(self, values: Mapping[str, jax.Array]) -> np.ndarray:
        return np.stack([np.asarray(values[path]) for path in self.space.paths], axis=1)

    def judge(self, values: Mapping[str, float], stream: Stream, count: int) -> Judgement:
        """Score numbers on scenarios of a stream."""
        problem = problem_of(with_numbers(self.study, values, "tuned study"))
        scores = Grid(problem, {}, count, stream).evaluate(np.empty((1, 0)))
        single = {name: score[0, 0] for name, score in scores.items()}
        return judge(single, self.study.tune, seed=self.study.seed)


def tune(search: Search, folder: Path, *, resume: bool = False, quiet: bool = False) -> Tuned:
    """Search, judge on held-out scenarios, and write `best.toml` and `results.parquet` to the run folder.

    Every finished screening and start is a chunk of the run: an interrupted search goes on where it was.
    """
    study = search.study
    refines = search.method != "grid"
    starts = study.tune.starts if refines else 0
    chunks = ["screen", *(f"start-{i:03d}" for i in range(starts))]
    plan = {"method": search.method, "algorithm": search.algorithm}
    store = open_run(folder, "tune", study, plan, chunks, resume=resume)
    with progress(f"tune ({search.method})", len(chunks), quiet=quiet) as advance:

        def finished(chunk: str, compute: Callable[[], dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
            rows = store.computed(chunk, partial(_timed, compute))
            advance()
            return rows

        screened = finished("screen", lambda: _screen(search))
        points = np.stack([screened[path] for path in search.space.paths], axis=1)
        order = np.argsort(np.where(np.isnan(screened["objective"]), np.inf, screened["objective"]))
        candidates = [dict(zip(search.space.paths, map(float, points[i]), strict=True)) for i in order]
        outcomes, seconds = [], float(np.sum(screened["seconds"]))
        for i, start in enumerate([search.own, *candidates][:starts]):
            row = finished(f"start-{i:03d}", lambda start=start: _refine(search, start))
            values = {path: float(row[path][0]) for path in search.space.paths}
            seconds += float(row["seconds"][0])
            outcomes.append(
                Outcome(start, values, float(row["objective"][0]), int(row["steps"][0]), str(row["message"][0]))
            )
    store.finish()
    tried = [(float(screened["objective"][order[0]]), candidates[0]), *((o.objective, o.values) for o in outcomes)]
    reached, best = min(tried, key=lambda one: one[0] if math.isfinite(one[0]) else math.inf)
    calibration = calibrate(with_numbers(study, best, "tuned study"))
    deployed = {**best, **calibration}
    tuned = Tuned(
        best,
        outcomes,
        search.judge(deployed, "train", study.scenarios.train),
        search.judge(deployed, "held_out", study.scenarios.held_out),
        search.judge(search.own, "held_out", study.scenarios.held_out),
        len(points) + sum(outcome.steps for outcome in outcomes),
        seconds,
        [(float(screened["objective"][i]), candidates[n]) for n, i in enumerate(order[:_SHOWN])],
        reached,
        find(study, with_numbers(study, best, "tuned study")),
        calibration,
    )
    source = {"method": search.method, "algorithm": search.algorithm}
    write_best(study, study, tuned, source, folder / "best.toml")
    return tuned


def plan_search(study: Study, method: Method, algorithm: Algorithm, place: str) -> Search:
    """Return the search that a study's `[tune]` table asks for.

    Raises:
        InputError: there is no parameter to tune, or there are choices, which these methods cannot make; or what
            the study names cannot be read.
    """
    if study.tune.choices:
        raise input_error(
            f"{place}: tune.choices",
            f"cannot be searched by --method {method}, which varies numbers only",
            "choose with --method tpe or pareto, then refine its best.toml",
        )
    if not study.tune.parameters:
        raise nothing_to_tune(study, place)
    # What cannot be computed is refused before anything is written.
    search = Search(study, method, algorithm)
    problem = search.problem
    if method != "grid":
        obstacle = study.no_gradient(place, method)
        if obstacle is None and not isinstance(problem, Differentiable):
            obstacle = lacking(place, study, "gradient (none is computed)", "use --method grid, tpe or cmaes")
        if obstacle is not None:
            raise InputError(obstacle)
    return search


def nothing_to_tune(study: Study, place: str) -> InputError:
    """Return the error of a study without parameters."""
    path, own = contested_number(study)
    fix = f'add one, e.g. [tune.parameters] "{path}" = {{ low = {0.1 * own:g}, high = {10.0 * own:g} }}'
    return input_error(f"{place}: tune.parameters", "names no number to tune", fix)


def write_best(study: Study, best: Study, tuned: Tuned, source: Mapping[str, Any], path: Path) -> None:
    """Write what is deployed of the tuned study, with its provenance.

    Args:
        study: what was tuned.
        best: the same, or the one of its structures that was chosen.
        tuned: what was found.
        source: how: the method and its options.
        path: where to.
    """
    provenance = {
        "command": "tune",
        **source,
        "objective": study.tune.objective,
        "statistic": study.tune.statistic.model_dump(),
        "study_hash": study_hash(study),
        "seed": study.seed,
        "versions": versions(study),
        "tuned": sorted(tuned.values),
        "calibrated": sorted(tuned.calibration),
        "train": _stated(tuned.train),
        "held_out": _stated(tuned.held_out),
        "before_on_held_out": _stated(tuned.before),
    }
    provenance = joined(provenance, tuned.finding.provenance)
    # TOML has no number for an infinite convergence time that every reader takes; JSON's way out is a string.
    told = json.loads(json.dumps(provenance), parse_constant=str)
    write_text(path, to_toml(descended(with_numbers(best, tuned.deployed, "tuned study").deployed(), told)))


def _stated(judgement: Judgement) -> dict[str, Any]:
    """Return a judgement without the interval that one scenario does not give."""
    return {
        name: value
        for name, value in judgement.summary().items()
        if name not in {"low", "high"} or math.isfinite(value)
    }


def _screen(search: Search) -> dict[str, np.ndarray]:
    points = search.sobol_points() if search.method == "gradient" else search.grid_points()
    return _rows(search, points, search.screen(points), np.zeros(len(points), int), "screened")


def _refine(search: Search, start: Mapping[str, float]) -> dict[str, np.ndarray]:
    outcome = search.tuner.run(dict(start))
    point = np.array([[outcome.values[path] for path in search.space.paths]])
    return _rows(search, point, np.array([outcome.objective]), np.array([outcome.steps]), outcome.message)


def _rows(
    search: Search, points: np.ndarray, objective: np.ndarray, steps: np.ndarray, message: str
) -> dict[str, Any]:
    columns: dict[str, Any] = {path: points[:, i] for i, path in enumerate(search.space.paths)}
    return columns | {"objective": objective, "steps": steps, "message": np.array([message] * len(points))}


def _timed(compute: Callable[[], dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Return rows with the seconds that each took."""
    begin, rows = time.perf_counter(), compute()
    count = len(rows["objective"])
    return rows | {"seconds": np.full(count, (time.perf_counter() - begin) / max(1, count))}
