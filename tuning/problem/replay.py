"""One scenario of a study, simulated again."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

from tuning.files.errors import input_error
from tuning.problem.interface import Recorded, Scenario, Stream, problem_of
from tuning.study.base import Study
from tuning.study.loading import with_numbers


def member(study: Study, scenario: int) -> Study:
    """Return one robot of a study's population, as a study without one."""
    drawn = problem_of(study).scenarios(replay_stream(study), 1, scenario).numbers
    alone = study.model_copy(update={"population": type(study.population)()})
    return with_numbers(alone, {path: float(value[0]) for path, value in drawn.items()}, f"scenario {scenario}")


def replay_stream(study: Study) -> Stream:
    """Return the stream whose scenarios `simulate` replays: those of `montecarlo` where there is a population."""
    return "population" if study.population.paths else "train"


def simulate(study: Study, scenario: int) -> tuple[dict[str, np.ndarray], int]:
    """Return the signals of a simulated scenario with its truth, and the integration steps a sample.

    Args:
        study: what is simulated.
        scenario: number of the robot in the population, or of the noise draw in the training stream.

    Raises:
        InputError: the motion is not finite.
    """
    problem: Recorded = problem_of(study)  # pyright: ignore[reportAssignmentType] - a kind with a picture has signals
    signals = problem.columns(replayed(study, scenario), problem.given)
    columns = {name: np.asarray(values) for name, values in signals.items()}
    require_finite(columns, *problem.if_not_finite)
    return columns, problem.substeps


def replayed(study: Study, scenario: int) -> Scenario:
    """Return the scenario that a number names."""
    return jax.tree.map(lambda x: x[0], problem_of(study).scenarios(replay_stream(study), 1, scenario))


def require_finite(signals: Any, key: str, way_out: str) -> None:
    """Refuse a simulation that is not finite: `key` names the table to look at."""
    if not all(np.isfinite(values).all() for values in jax.tree.leaves(signals)):
        raise input_error(key, "the simulated motion is not finite", way_out)
