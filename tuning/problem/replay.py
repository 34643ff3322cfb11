"""One recording: simulated from a study, or estimated from a file."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

from tuning.files.errors import input_error
from tuning.problem.interface import ControlProblem, problem_of
from tuning.problem.scenarios import Problem, Scenario, Stream, draw_scenarios
from tuning.study.loading import DampingStudy, EstimationStudy, Study, with_numbers
from vsajax.closed_loop import Exchange


def member(study: Study, scenario: int) -> Study:
    """Return one robot of a study's population, as a study without one."""
    drawn = draw_scenarios(study, replay_stream(study), 1, scenario).numbers
    alone = study.model_copy(update={"population": type(study.population)()})
    return with_numbers(alone, {path: float(value[0]) for path, value in drawn.items()}, f"scenario {scenario}")


def replay_stream(study: Study) -> Stream:
    """Return the stream whose scenarios `simulate` replays: those of `montecarlo` where there is a population."""
    return "population" if study.population.paths else "train"


def simulate_recording(study: EstimationStudy, scenario: int) -> tuple[dict[str, np.ndarray], int]:
    """Return the columns of a simulated recording with its truth, and the integration steps a sample.

    Args:
        study: what is simulated.
        scenario: number of the robot in the population, or of the noise draw in the training stream.

    Raises:
        InputError: the motion is not finite.
    """
    problem = Problem(study)
    drawn = _replayed(study, scenario)
    truth, recording = problem.record(drawn, problem.given)
    signals = {name: value for name, value in recording._asdict().items() if value is not None}
    signals |= {
        "true_stiffness": truth.motion.stiffness,
        "true_elastic_torque": truth.motion.elastic_torque,
    }
    columns = {name: np.asarray(value) for name, value in signals.items()}
    _check_finite(columns, "joint", "check its springs, inertias and excitation")
    return columns, problem.substeps


def simulate_swing(study: Study, scenario: int) -> tuple[dict[str, np.ndarray], int]:
    """Return the columns of a simulated closed loop, and the integration steps a sample.

    Args:
        study: what is simulated.
        scenario: number of the robot in the population, or of the noise draw in the training stream.

    Raises:
        InputError: the motion is not finite.
    """
    problem = problem_of(study)
    assert isinstance(problem, ControlProblem)
    drawn = _replayed(study, scenario)
    motion = problem.motion(drawn, problem.given)
    columns = {
        "time": motion.time,
        "link_position": motion.positions[0],
        "link_velocity": motion.velocities[0],
        "motor_position": motion.motor_positions[0],
        "true_stiffness": motion.stiffness[0],
        "commanded_stiffness": motion.commanded[0],
    }
    found = {name: np.asarray(values) for name, values in columns.items()}
    _check_finite(found, "controller", "check its gains, or set `substeps`")
    return found, problem.substeps


def simulate_exchange(study: DampingStudy, scenario: int) -> Exchange:
    """Return what the controller was told in the loop that `simulate_swing` runs, and what it answered."""
    problem = ControlProblem(study)
    drawn = _replayed(study, scenario)
    exchange = problem.exchange(drawn, problem.given)
    _check_finite(exchange, "controller", "check its gains, or set `substeps`")
    return exchange


def _replayed(study: Study, scenario: int) -> Scenario:
    """Return the scenario that a number names."""
    return jax.tree.map(lambda x: x[0], draw_scenarios(study, replay_stream(study), 1, scenario))


def _check_finite(signals: Any, key: str, way_out: str) -> None:
    if not all(np.isfinite(values).all() for values in jax.tree.leaves(signals)):
        raise input_error(key, "the simulated motion is not finite", way_out)
