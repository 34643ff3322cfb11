"""Stiffness switching in closed form: the exact law, the optimal control behind it, and the fastest rule."""

from vsajax.switching.law import Exact, decay_rate, exact_motion
from vsajax.switching.optimum import (
    EndCost,
    Extremal,
    Optimum,
    extremal_to,
    optimum,
    switched_end,
    time_since_centre,
    time_since_turn,
)
from vsajax.switching.oscillator import Oscillator, Phase
from vsajax.switching.rate import best_release, release_rate

__all__ = [
    "EndCost",
    "Exact",
    "Extremal",
    "Optimum",
    "Oscillator",
    "Phase",
    "best_release",
    "decay_rate",
    "exact_motion",
    "extremal_to",
    "optimum",
    "release_rate",
    "switched_end",
    "time_since_centre",
    "time_since_turn",
]
