"""vsajax: differentiable batch estimation of the stiffness of variable-stiffness robot joints.

Everything is one function and what JAX does to it::

    score = metric(truth, estimate(estimator, measure(sensors, simulate(joint, excitation))))

and, for controllers that damp by stiffness, ``score = metric(simulate(plant, controller, impact))``.
"""

from vsajax import (
    arms,
    compliance,
    control,
    estimators,
    experiments,
    guard,
    moved,
    numerics,
    plants,
    rollout,
    scores,
    sensing,
    solvers,
    switching,
)
from vsajax.experiments.damping import ControlLoop, SwingMotion
from vsajax.experiments.estimation import Bench, Truth, estimate, measure, score, simulate
from vsajax.guard import Guarded
from vsajax.scores.estimates import Scorer, Scores
from vsajax.scores.swings import SwingScorer, SwingScores
from vsajax.types import Command, Estimate, MissingSignalError, PrecisionError, Recording, Sample, Swing

__version__ = "0.1.0"

_MOVED = {
    "antagonistic_loop": "vsajax.experiments.antagonistic_damping",
    "arm_loop": "vsajax.experiments.arm",
    "closed_loop": "vsajax.experiments.damping",
    "estimated_loop": "vsajax.experiments.estimated_damping",
    "experiment": "vsajax.experiments.estimation",
    "metrics": "vsajax.scores.estimates",
    "sensitivity": "vsajax.rollout.sensitivity",
    "settling": "vsajax.scores.swings",
}
_FROM_CONTROL = {
    "compliance": ("passive", "active", "designer", "loaded", "pose", "impedance", "online"),
    "solvers": ("active_set", "box", "enumeration", "interior_point", "spectrum", "working_set"),
}
moved.keep_modules(
    {f"vsajax.{old}": new for old, new in _MOVED.items()}
    | {f"vsajax.control.{name}": f"vsajax.{new}.{name}" for new, names in _FROM_CONTROL.items() for name in names}
)
__getattr__ = moved.old_names("vsajax", _MOVED)

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
    "arms",
    "compliance",
    "control",
    "estimate",
    "estimators",
    "experiments",
    "guard",
    "measure",
    "numerics",
    "plants",
    "rollout",
    "score",
    "scores",
    "sensing",
    "simulate",
    "solvers",
    "switching",
]
