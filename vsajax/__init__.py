"""vsajax: differentiable batch estimation of the stiffness of variable-stiffness robot joints.

Everything is one function and what JAX does to it::

    score = metric(truth, estimate(estimator, measure(sensors, simulate(joint, excitation))))

and, for controllers that damp by stiffness, ``score = metric(simulate(plant, controller, impact))``.
"""

from vsajax import (
    antagonistic_loop,
    arm_loop,
    arms,
    closed_loop,
    control,
    estimated_loop,
    estimators,
    experiment,
    guard,
    metrics,
    numerics,
    plants,
    rollout,
    sensing,
    sensitivity,
    settling,
    switching,
)
from vsajax.closed_loop import ControlLoop, SwingMotion
from vsajax.experiment import Bench, Truth, estimate, measure, score, simulate
from vsajax.guard import Guarded
from vsajax.metrics import Scorer, Scores
from vsajax.settling import SwingScorer, SwingScores
from vsajax.types import Command, Estimate, MissingSignalError, PrecisionError, Recording, Sample, Swing

__version__ = "0.1.0"

__all__ = [
    "Bench",
    "Command",
    "ControlLoop",
    "Estimate",
    "Guarded",
    "MissingSignalError",
    "PrecisionError",
    "Recording",
    "Sample",
    "Scorer",
    "Scores",
    "Swing",
    "SwingMotion",
    "SwingScorer",
    "SwingScores",
    "Truth",
    "antagonistic_loop",
    "arm_loop",
    "arms",
    "closed_loop",
    "control",
    "estimate",
    "estimated_loop",
    "estimators",
    "experiment",
    "guard",
    "measure",
    "metrics",
    "numerics",
    "plants",
    "rollout",
    "score",
    "sensing",
    "sensitivity",
    "settling",
    "simulate",
    "switching",
]
