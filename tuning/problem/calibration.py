"""What a kind of study sets of a found configuration so that it states no more than it knows."""

from __future__ import annotations

from collections.abc import Mapping

from tuning.study.base import Study
from tuning.study.kinds import kind_of


def calibrate(best: Study) -> Mapping[str, float]:
    """Return the numbers by path with which what a search has found holds what it says, on training scenarios.

    Args:
        best: the study at the numbers that were found.

    Returns:
        Nothing where its kind states no band, or the band is never stated.
    """
    make = kind_of(best).calibration
    return {} if make is None else make.load()(best)


def is_band(path: str) -> bool:
    """Return whether the number at a path is a factor on a band: all that `calibrate` may set."""
    return path.startswith("estimator.") and path.endswith(".fit.band")
