"""What the plans of an arm's study need, from its numbers alone; nothing here imports jax."""

from __future__ import annotations

from tuning.kinds.arm.study import ArmStudy
from tuning.runs.machine import usable_cores
from tuning.study.limits import Need, Needs, in_count, product

_POSE_BYTES, _POSE_SECONDS = 2500, 5e-5
"""Of a pose's outcome, in programs, in the table and in the picture."""
_CELL_BYTES = 400
"""Of a cell of the map."""
_STEP_SECONDS = 2e-5
"""Of a step of a search for better poses."""


def of_workspace(study: ArmStudy, place: str) -> list[Need]:
    """Return what a map of the workspace needs."""
    poses, cells = study.workspace.poses, study.workspace.cells
    return [
        Need(
            f"{place}: workspace.poses",
            f"{in_count(poses)} poses",
            "draw fewer",
            memory=product(poses, _POSE_BYTES),
            seconds=product(poses) * _POSE_SECONDS / usable_cores(),
        ),
        Need(
            f"{place}: workspace.cells",
            f"{in_count(cells)} × {in_count(cells)} cells",
            "draw a coarser map",
            memory=product(cells, cells, _CELL_BYTES),
        ),
    ]


def of_poses(study: ArmStudy, place: str) -> list[Need]:
    """Return what a search for better poses needs."""
    own = study.poses
    return [
        Need(
            f"{place}: poses",
            f"{in_count(own.targets)} targets × {in_count(own.starts)} starts × {in_count(own.steps)} steps",
            "search fewer of these",
            memory=product(own.targets, own.starts, _POSE_BYTES),
            seconds=product(own.targets, own.starts, own.steps) * _STEP_SECONDS / usable_cores(),
        )
    ]


def of_accuracy(study: ArmStudy, place: str) -> list[Need]:
    """Return what arms with errors in their stiffness need, as many as the study draws at each level."""
    count, levels = study.accuracy.draws, len(study.levels)
    drawn = product(count, levels)
    return [
        Need(
            f"{place}: accuracy.draws",
            f"{in_count(count)} arms at each of {levels} levels",
            "draw fewer",
            memory=drawn * _POSE_BYTES,
            seconds=drawn * _POSE_SECONDS / usable_cores(),
        )
    ]


def of_arm(study: ArmStudy, place: str) -> list[Need]:
    """Return all that an arm's study asks for."""
    return [*of_workspace(study, place), *of_poses(study, place), *of_accuracy(study, place)]


NEEDS = Needs(of_arm, (_POSE_BYTES, _POSE_SECONDS))
