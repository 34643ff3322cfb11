"""Tuning without derivatives: Optuna asks for batches of trials, which run as lanes of one compiled program.

RUN/optuna.log   Optuna's journal of all trials; see `journal`
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import metadata
from pathlib import Path
from typing import Any, Literal

import numpy as np
import optuna
from optuna.samplers import BaseSampler, CmaEsSampler, TPESampler

from tuning.files.errors import InputError, input_error
from tuning.problem.calibration import calibrate
from tuning.problem.finding import find
from tuning.runs.folder import open_run
from tuning.runs.journal import Journal, open_journal
from tuning.search.refine import Search, Tuned, nothing_to_tune, write_best
from tuning.study.base import Study, Timed
from tuning.study.choices import Chosen
from tuning.study.kinds import lacking
from tuning.study.loading import with_numbers
from tuning.study.scores import time_of
from tuning.study.structures import structures
from tuning.terminal.progress import progress

BlackBoxMethod = Literal["tpe", "cmaes", "pareto"]

_FAILED = 1e30
"""Told of a trial without a finite score: all samplers go by ranks, and learn to stay away from it."""


@dataclass(frozen=True)
class Trial:
    """A scored configuration.

    Args:
        number: in the order of asking.
        chosen: option by choice.
        values: the tuned numbers by path; only those that exist in the chosen structure.
        objective: statistic of the training objective [%]; NaN where it failed.
        convergence_time: median over the training scenarios, at most the recording's duration; `None` where
            nothing moves [s].
        seconds: since the search began, without interruptions.
    """

    number: int
    chosen: Chosen
    values: dict[str, float]
    objective: float
    convergence_time: float | None
    seconds: float

    @property
    def scores(self) -> dict[str, float]:
        """The objective, and the time where there is one."""
        time = {} if self.convergence_time is None else {"convergence_time": self.convergence_time}
        return {"objective": self.objective} | time

    @property
    def is_scored(self) -> bool:
        """Whether its scores are finite."""
        return all(map(math.isfinite, self.scores.values()))

    def row(self) -> dict[str, Any]:
        """Return it as one flat row."""
        chosen = {_choice_key(name): option for name, option in self.chosen.items()}
        return {"number": self.number, **chosen, **self.values, **self.scores}


@dataclass(frozen=True)
class Explored:
    """What a black-box search found.

    Args:
        tuned: the best trial's numbers, and its judgement on held-out scenarios.
        best: the best trial: of a Pareto front, the most accurate.
        trials: all of them.
        front: those that no other beats in both accuracy and convergence time; without "pareto", only the best.
    """

    tuned: Tuned
    best: Trial
    trials: list[Trial]
    front: list[Trial]

    @property
    def failed(self) -> int:
        """How many trials had no finite score."""
        return sum(not trial.is_scored for trial in self.trials)


@dataclass(frozen=True)
class BlackBox:
    """A search over the `[tune]` parameters and choices of a study that needs scores only.

    Args:
        study: the study.
        method: "tpe": tree-structured Parzen estimator; "cmaes": CMA-ES, one generation a batch; "pareto": the
            former for two objectives, accuracy and convergence time.
        batch: trials asked for, and evaluated, at a time.
    """

    study: Study
    method: BlackBoxMethod
    batch: int = 16

    @cached_property
    def searches(self) -> dict[tuple[str, ...], Search]:
        """The search of each structure by its options; a program is compiled when the first trial needs it."""
        found = structures(self.study, "study")
        return {tuple(chosen.values()): Search(study, self.method) for chosen, study in found}

    def build(self) -> None:
        """Make the problem of every structure: what cannot be computed is told ahead of what is written."""
        for search in self.searches.values():
            _ = search.problem

    def search_of(self, chosen: Chosen) -> Search:
        """Return the search of a combination of options."""
        return self.searches[tuple(chosen.values())]

    def sampler(self, batch: int, ahead: optuna.Study) -> BaseSampler:
        """Return a sampler for one batch; seeded by its number, it does not depend on interruptions before it."""
        seed = int(np.random.SeedSequence((self.study.seed, batch)).generate_state(1)[0])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
            # Optuna 6 takes these arguments away; the version is bounded below it.
            warnings.filterwarnings("ignore", "`[a-z0-9_]+` has been deprecated in v4", FutureWarning)
            if self.method == "cmaes":
                # The first batch is spread at random; its best is the mean of the first generation.
                start = ahead.best_params if batch else None
                return CmaEsSampler(x0=start, seed=seed, popsize=self.batch, warn_independent_sampling=False)
            return TPESampler(
                seed=seed,
                multivariate=True,
                group=bool(self.study.tune.choices),
                constant_liar=True,
            )

    def suggest(self, trial: optuna.Trial) -> tuple[Chosen, dict[str, float]]:
        """Return the options and numbers of a trial."""
        choices = self.study.tune.choices
        chosen = {name: trial.suggest_categorical(_choice_key(name), list(choices[name])) for name in choices}
        bounds = self.search_of(chosen).study.tune.parameters
        return chosen, {
            path: trial.suggest_float(path, b.low, b.high, log=b.scale == "log") for path, b in bounds.items()
        }

    def own(self) -> list[dict[str, Any]]:
        """Return the first trials: the numbers that the study has, in each structure."""
        first = []
        for options, search in list(self.searches.items())[: self.batch]:
            chosen = zip(map(_choice_key, self.study.tune.choices), options, strict=True)
            bounds = search.study.tune.parameters
            numbers = {path: float(np.clip(search.own[path], *bounds[path].ends())) for path in bounds}
            first.append(dict(chosen) | numbers)
        return first

    def evaluate(self, asked: Sequence[tuple[Chosen, Mapping[str, float]]]) -> np.ndarray:
        """Return `(trial, 2)` objectives and convergence times [s]; a structure's trials are one batch.

        Where nothing moves there are no times, and one column.
        """
        scored = np.full((len(asked), 2 if isinstance(self.study, Timed) else 1), np.nan)
        for options, search in self.searches.items():
            members = [i for i, (chosen, _) in enumerate(asked) if tuple(chosen.values()) == options]
            if not members:
                continue
            points = np.array([[asked[i][1][path] for path in search.paths] for i in members], dtype=float)
            # Always as many lanes: one program serves every batch.
            filled = np.pad(points, ((0, self.batch - len(members)), (0, 0)), mode="edge")
            scores = search.score(filled)
            objective = search.study.tune.statistic.of(np.asarray(getattr(scores, search.study.tune.objective)))
            found = [objective]
            if isinstance(search.study, Timed):
                times = np.minimum(np.asarray(scores.convergence_time), search.study.clock.duration)
                found.append(np.median(times, axis=-1))
            scored[members] = np.stack(found, axis=1)[: len(members)]
        return scored

    def told(self, score: np.ndarray) -> list[float]:
        """Return what Optuna is told of a trial's score."""
        used = score if self.method == "pareto" else score[:1]
        return [float(x) for x in used] if np.isfinite(score).all() else [_FAILED] * len(used)


def plan_blackbox(study: Study, method: BlackBoxMethod, batch: int, place: str) -> BlackBox:
    """Return the black-box search that a study's `[tune]` table asks for.

    Raises:
        InputError: there is nothing to tune, or the method cannot tune it.
    """
    tune = study.tune
    if not tune.parameters and not tune.choices:
        raise nothing_to_tune(study, place)
    if method == "cmaes" and tune.choices:
        problem = "cannot be searched by --method cmaes, which varies numbers only"
        raise input_error(f"{place}: tune.choices", problem, "choose with --method tpe or pareto")
    if method == "cmaes" and (len(tune.parameters) < 2 or batch < 4):
        problem = f"got {len(tune.parameters)}, and --batch {batch}"
        fix = "CMA-ES needs two or more parameters and batches of four or more; use --method tpe"
        raise input_error(f"{place}: tune.parameters", problem, fix)
    if method == "pareto" and time_of(tune.objective) is None:
        why = "nothing moves, and --method pareto holds accuracy against it"
        raise InputError(lacking(place, study, f"convergence time ({why})", "use --method cmaes or tpe"))
    box = BlackBox(study, method, batch)
    box.build()
    return box


def explore(
    box: BlackBox, folder: Path, *, trials: int = 128, resume: bool = False, quiet: bool = False
) -> Explored:
    """Search, judge on held-out scenarios, and write `best.toml` and `results.parquet` to the run folder.

    Every whole batch is kept: an interrupted search goes on where it was, as if it had not been interrupted. How
    many trials there are does not belong to the run: a finished one goes on to a larger number.

    Raises:
        InputError: the folder holds another run, or no trial had a finite score.
    """
    store = open_run(folder, "tune", box.study, {"method": box.method, "batch": box.batch}, [], resume=resume)
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    journal = open_journal(store, 2 if box.method == "pareto" else 1)
    if journal.batches == 0:
        for first in box.own():
            journal.study.enqueue_trial(first)
    with progress(f"tune ({box.method})", trials, quiet=quiet) as advance:
        done = read_trials(journal)
        advance(min(len(done), trials))
        began = time.perf_counter() - max((trial.seconds for trial in done), default=0.0)
        while (count := min(box.batch, trials - len(done))) > 0:
            run_batch(box, journal, count, began)
            done = read_trials(journal)
            advance(count)
    store.write_results(_columns(box, done))
    return _conclude(box, done, folder)


def run_batch(box: BlackBox, journal: Journal, count: int, began: float) -> None:
    """Ask for some trials, evaluate them, tell their scores, and mark the journal."""
    search = journal.study
    search.sampler = box.sampler(journal.batches, search)
    asked = [search.ask() for _ in range(count)]
    scores = box.evaluate([box.suggest(trial) for trial in asked])
    seconds = time.perf_counter() - began
    for trial, score in zip(asked, scores, strict=True):
        # JSON has no NaN that every reader takes.
        kept = [float(x) if math.isfinite(x) else None for x in score]
        named = dict(zip(("objective", "convergence_time"), kept, strict=False))
        trial.set_user_attr("scored", named | {"seconds": seconds})
        search.tell(trial, box.told(score))
    journal.mark()


def read_trials(journal: Journal) -> list[Trial]:
    """Return the finished trials of a journal.

    Raises:
        InputError: it holds trials that no such search wrote.
    """
    finished = journal.study.get_trials(deepcopy=False, states=[optuna.trial.TrialState.COMPLETE])
    prefix = _choice_key("")
    found = []
    for trial in finished:
        if "scored" not in trial.user_attrs:
            problem = f"has no scores of trial {trial.number}"
            raise input_error(journal.path, problem, "remove it; --resume asks for its trials again")
        scored = {k: math.nan if x is None else x for k, x in trial.user_attrs["scored"].items()}
        chosen = {p.removeprefix(prefix): option for p, option in trial.params.items() if p.startswith(prefix)}
        values = {path: value for path, value in trial.params.items() if not path.startswith(prefix)}
        found.append(Trial(trial.number, chosen, values, **{"convergence_time": None, **scored}))
    return found


def find_front(trials: Sequence[Trial]) -> list[Trial]:
    """Return the scored trials that no other beats in accuracy or convergence time, the most accurate first."""
    front: list[Trial] = []
    for trial in sorted(trials, key=lambda t: (t.objective, _time(t), t.number)):
        if trial.is_scored and (not front or _time(trial) < _time(front[-1])):
            front.append(trial)
    return front


def _time(trial: Trial) -> float:
    """Return when a trial has converged; at once where nothing moves: the front is then its best."""
    return trial.convergence_time or 0.0


def _conclude(box: BlackBox, trials: list[Trial], folder: Path) -> Explored:
    study = box.study
    scored = [trial for trial in trials if trial.is_scored]
    if not scored:
        problem = f"none of {len(trials)} trials had a finite score"
        raise input_error(folder / "results.parquet", problem, "narrow the bounds of tune.parameters")
    front = find_front(scored)
    best, search = front[0], box.search_of(front[0].chosen)
    calibration = calibrate(with_numbers(search.study, best.values, "tuned study"))
    deployed = {**best.values, **calibration}
    tuned = Tuned(
        best.values,
        [],
        search.judge(deployed, "train", study.scenarios.train),
        search.judge(deployed, "held_out", study.scenarios.held_out),
        Search(study, box.method).judge({}, "held_out", study.scenarios.held_out),
        len(trials),
        trials[-1].seconds,
        objective=best.objective,
        finding=find(study, with_numbers(search.study, best.values, "tuned study")),
        calibration=calibration,
    )
    explored = Explored(tuned, best, trials, front if box.method == "pareto" else [best])
    source = {
        "method": box.method,
        "batch": box.batch,
        "trials": len(trials),
        "failed": explored.failed,
        "seconds": tuned.seconds,
        "choices": best.chosen,
        "samplers": {name: metadata.version(name) for name in ("optuna", "cmaes")},
    }
    write_best(study, search.study, tuned, source, folder / "best.toml")
    return explored


def _columns(box: BlackBox, trials: Sequence[Trial]) -> dict[str, np.ndarray]:
    """Return a row a trial; a number that a structure does not have is NaN there."""
    columns = {"number": np.array([trial.number for trial in trials], dtype=int)}
    for name in box.study.tune.choices:
        columns[_choice_key(name)] = np.array([trial.chosen[name] for trial in trials])
    for path in box.study.tune.parameters:
        columns[path] = np.array([trial.values.get(path, math.nan) for trial in trials])
    for name in trials[0].scores:
        columns[name] = np.array([trial.scores[name] for trial in trials])
    # Of a batch, which is timed as a whole, each trial's share.
    ends, batch, size = np.unique([trial.seconds for trial in trials], return_inverse=True, return_counts=True)
    columns["seconds"] = (np.diff(ends, prepend=0.0) / size)[batch]
    return columns | {"state": np.array(["scored" if trial.is_scored else "failed" for trial in trials])}


def _choice_key(name: str) -> str:
    return f"choices.{name}"
