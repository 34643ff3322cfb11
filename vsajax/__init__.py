"""vsajax: differentiable batch estimation of the stiffness of variable-stiffness robot joints.

Everything is one function and what JAX does to it::

    score = metric(truth, estimate(estimator, measure(sensors, simulate(joint, excitation))))
"""

from vsajax import arm_loop, arms, control, estimators, experiment, metrics, numerics, plants, rollout, sensing
from vsajax.experiment import Bench, Truth, estimate, measure, score, simulate
from vsajax.metrics import Scorer, Scores
from vsajax.types import Estimate, MissingSignalError, PrecisionError, Recording, Sample

__version__ = "0.1.0"

__all__ = [
    "Bench",
    "Estimate",
    "MissingSignalError",
    "PrecisionError",
    "Recording",
    "Sample",
    "Scorer",
    "Scores",
    "Truth",
    "arm_loop",
    "arms",
    "control",
    "estimate",
    "estimators",
    "experiment",
    "measure",
    "metrics",
    "numerics",
    "plants",
    "rollout",
    "score",
    "sensing",
    "simulate",
]
