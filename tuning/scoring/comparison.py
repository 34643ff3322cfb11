"""Several estimators side by side: the same joints, the same noise, paired scenario by scenario."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from tuning.files.errors import InputError, Mistake
from tuning.problem.interface import Problem, problem_of
from tuning.runs.folder import open_run
from tuning.scoring.grid import Grid
from tuning.scoring.intervals import Judgement, equal_to_rounding, judge, paired_interval
from tuning.study.base import Base, Study, resolved, study_hash
from tuning.study.loading import parse_study
from tuning.terminal.progress import progress


@dataclass(frozen=True)
class Contender:
    """One configuration in a comparison.

    Args:
        name: its label.
        judgement: its own scores.
        difference: statistic of its objective minus the first configuration's, on the same scenarios [%].
        low: lower end of the difference's 95 % interval.
        high: upper end.
        wins: share of scenarios in which it is better than the first.
        ties: share of scenarios in which both are equal to rounding.
    """

    name: str
    judgement: Judgement
    difference: float
    low: float
    high: float
    wins: float
    ties: float

    @property
    def verdict(self) -> str:
        """What the difference says: "equal" (to rounding), "tie" (its interval holds 0), "better" or "worse".

        Of one scenario it says nothing more than itself: "no interval".
        """
        if self.ties == 1.0:
            return "equal"
        if self.judgement.scenarios == 1:
            return "no interval"
        if not (self.low > 0.0 or self.high < 0.0):
            return "tie"
        return "worse" if self.low > 0.0 else "better"


def contenders(configs: Mapping[str, Base], study: Study, place: str) -> dict[str, Study]:
    """Return the study once for each configuration's estimator.

    Raises:
        InputError: an estimator does not fit the study; every one that does not is named.
    """
    studies, mistakes = {}, []
    base = resolved(study) | {"sweep": {}, "tune": study.tune.model_dump(include={"objective", "statistic"})}
    for name, config in configs.items():
        if config.kind != study.kind:
            fix = f"compare it on a study of kind {config.kind!r}"
            mistakes.append(Mistake(f"{name}: kind", f"got {config.kind!r}, but {place} is {study.kind!r}", fix))
            continue
        tables = resolved(config)
        own = {part: tables[part] for part in study.contested if part in tables}
        try:
            studies[name] = parse_study(base | own, f"{name} on {place}")
        except InputError as error:
            mistakes += error.mistakes
    if mistakes:
        raise InputError(*mistakes)
    return studies


def compare(
    studies: Mapping[str, Study], folder: Path, *, resume: bool = False, quiet: bool = False
) -> list[Contender]:
    """Score every estimator on the held-out scenarios and compare each with the first.

    Each estimator is a chunk of the run.
    """
    names, first = list(studies), next(iter(studies.values()))
    plan = {name: study_hash(study) for name, study in studies.items()}
    # What cannot be computed is told ahead of what is written.
    problems = {name: problem_of(study) for name, study in studies.items()}
    store = open_run(folder, "compare", first, plan, [f"{i:03d}" for i in range(len(names))], resume=resume)
    scores: list[dict[str, np.ndarray]] = []
    with progress("compare", len(names), quiet=quiet) as advance:
        for chunk, name in zip(store.chunks, names, strict=True):
            scores.append(store.computed(chunk, partial(_score, name, problems[name])))
            advance()
    store.finish()
    return _pair(names, scores, first)


def _score(name: str, problem: Problem) -> dict[str, np.ndarray]:
    count = problem.study.scenarios.held_out
    scores = Grid(problem, {}, count, "held_out").evaluate(np.empty((1, 0)))
    single = {key: value[0, 0] for key, value in scores.items()}
    return {"configuration": np.array([name] * count), "scenario": np.arange(count), **single}


def _pair(names: Sequence[str], scores: Sequence[Mapping[str, np.ndarray]], study: Study) -> list[Contender]:
    tune, seed = study.tune, study.seed
    reference = scores[0][tune.objective]
    found = []
    for name, score in zip(names, scores, strict=True):
        both = np.isfinite(score[tune.objective]) & np.isfinite(reference)
        first, own = reference[both], score[tune.objective][both]
        difference = paired_interval(first, own, tune.statistic, seed=seed)
        equal = equal_to_rounding(first, own)
        wins, ties = (float(np.mean(x)) if own.size else math.nan for x in ((own < first) & ~equal, equal))
        found.append(Contender(name, judge(score, tune, seed=seed), *difference, wins, ties))
    return found
