"""How torque and deflection agree over the parts of a log, at numbers that a search has found."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import jax
import numpy as np

from tuning.kinds.log.problem import LogProblem
from tuning.kinds.log.study import LogStudy
from tuning.pictures.page import Table
from tuning.problem.finding import Finding
from vsajax.experiments import estimation

_WITHIN = 0.999
_PARTS = {"train": "training", "held_out": "held out", "whole": "whole log"}


@dataclass(frozen=True)
class Agreement:
    """How well a torque signal agrees with the deflection over a part of a log.

    Args:
        correlation: with the deflection lagging as the torque does.
        unlagged: with the deflection itself.
        stiffness: slope of the line [N·m/rad].
        rms: of the torque signal [N·m].
        samples: of that part.
    """

    correlation: float
    unlagged: float
    stiffness: float
    rms: float
    samples: int


def find_agreement(study: LogStudy, best: LogStudy) -> Finding:
    """Return what there is to say of the best numbers that a search on a log has found.

    Args:
        study: what was tuned.
        best: the same at these numbers.
    """
    problem = LogProblem(best)
    torque, lagging = (np.asarray(x) for x in jax.jit(problem.signals)({}, problem.given))
    estimate = jax.jit(estimation.estimate)(problem.given.estimator, problem.given.recording)
    deflection, train = np.asarray(estimate.signals.deflection), np.asarray(problem.given.is_training)
    places = dict(zip(_PARTS, (train, ~train, np.ones_like(train)), strict=True))
    parts = {name: agreement_of(torque, lagging, deflection, at) for name, at in places.items()}
    floor = float(np.quantile(np.abs(torque[train]), _WITHIN))
    within = float(np.mean(np.abs(torque[~train]) <= floor))
    tables = {name: asdict(part) for name, part in parts.items()}
    provenance = {
        "recording": study.recording.model_dump(exclude_none=True),
        **{name: tables[name] for name in ("train", "held_out")},
        "noise_floor": floor,
        "held_out_within_floor": within,
    }
    is_agreement = study.tune.objective == "agreement"
    before, after = (objective_of(one) for one in (study, best))
    facts = {"before": before, **tables, "floor": floor, "share_within": within}
    sentences = [f"{study.tune.objective} on the training part: {before:.4g} % before, {after:.4g} % tuned"]
    sentences += [] if is_agreement else [say_floor(floor, within)]
    notes = list(problem.table.notes)
    return Finding(facts | {"notes": notes}, provenance, notes, _tabulate(parts, is_agreement), sentences)


def objective_of(study: LogStudy) -> float:
    """Return a study's objective at its own numbers on the training part [%]."""
    problem = LogProblem(study)
    scenario = jax.tree.map(lambda x: x[0], problem.scenarios("train", 1))
    return float(getattr(jax.jit(problem.outcome)({}, scenario, problem.given).scores, study.tune.objective))


def agreement_of(torque: np.ndarray, lagging: np.ndarray, deflection: np.ndarray, at: np.ndarray) -> Agreement:
    """Return how well a torque agrees with a deflection at some samples.

    Args:
        torque: `(time,)` [N·m].
        lagging: `(time,)` deflection, lagging as the torque does [rad].
        deflection: `(time,)` as measured [rad].
        at: `(time,)` which samples count.
    """

    def correlation(x: np.ndarray) -> float:
        x, y = x[at] - x[at].mean(), torque[at] - torque[at].mean()
        size = math.sqrt(float(x @ x) * float(y @ y))
        return float(x @ y) / size if size > 0.0 else math.nan

    moved = lagging[at] - lagging[at].mean()
    squares = float(moved @ moved)
    return Agreement(
        correlation(lagging),
        correlation(deflection),
        float(moved @ torque[at]) / squares if squares > 0.0 else math.nan,
        float(np.sqrt(np.mean(torque[at] ** 2))),
        int(np.count_nonzero(at)),
    )


def say_floor(floor: float, within: float) -> str:
    """Return what the noise floor of the training part [N·m] is worth on the held-out part."""
    return (
        f"± {floor:.4g} N·m holds {100 * within:.4g} % of the held-out part's torque (and, being chosen so, "
        "99.9 % of the training part's)"
    )


def _tabulate(parts: dict[str, Agreement], is_agreement: bool) -> Table:
    if is_agreement:
        headers = ["", "correlation", "without the lag", "stiffness [N·m/rad]", "samples"]
        rows = [[_PARTS[n], p.correlation, p.unlagged, p.stiffness, p.samples] for n, p in parts.items()]
    else:
        headers = ["", "rms [N·m]", "samples"]
        rows = [[_PARTS[n], p.rms, p.samples] for n, p in parts.items()]
    return Table("Agreement of torque and deflection", headers, rows)
