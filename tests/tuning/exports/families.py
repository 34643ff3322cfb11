"""One configuration of each family, brief, and what all formats of it are written from."""

from __future__ import annotations

import functools

from tests.tuning.builders import ANTAGONISTIC, RESIDUAL_PAIR, SERIAL, SMALL, TINY
from tuning.exports.artefact import Subject
from tuning.exports.deployable import load_deployable
from tuning.exports.export import subject_of
from tuning.files.shipped import CONFIGS

ARM = CONFIGS / "studies" / "arm.toml"
DAMPING = CONFIGS / "studies" / "damping.toml"
TARGETS = ("toml", "json", "c99", "fmi2", "fmi3", "ros2", "mat", "stablehlo")
FAMILIES = {
    "fit": (SERIAL, (*SMALL, *TINY), 0.05),
    "algebraic": (ANTAGONISTIC, ("estimator.side.window=0.02", "estimator.side.longest_window=0.02"), 0.03),
    "pair": (RESIDUAL_PAIR, (), 0.03),
    "damping": (DAMPING, (), 0.03),
    "arm": (ARM, (), 0.1),
}
"""File, settings and seconds of the golden recording."""


@functools.cache
def subject(family: str) -> Subject:
    """Return what is exported of a family; traced and simulated once."""
    path, settings, seconds = FAMILIES[family]
    return subject_of(load_deployable(path, settings), path, seconds=seconds)
