"""The design for one pose, told in full."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array

from tuning.arm.problem import ArmProblem, Outcome, pose_of
from tuning.arm.study import ArmStudy
from vsajax.arms import task_scale
from vsajax.control import Status, StiffnessDesign

_MATRICES = ("passive_stiffness", "active_stiffness", "serial_stiffness")
_BOUND = {-1: "upper", 0: "free", 1: "lower"}


@dataclass(frozen=True)
class PoseDesign:
    """What to set the joints and the controller to at a pose, and what the hand then has.

    Args:
        pose: [rad].
        hand: position [m].
        status: whether it can be met.
        joint_stiffness: [N·m/rad].
        held: for each joint, whether the fit held its stiffness at "lower" or "upper", or left it "free".
        scale: factor on the passive compliances.
        matrices: passive, active, serial stiffness in the task's units [N/m], [N], [N·m/rad].
        errors: relative, by name.
        is_exact: whether the desired stiffness is met.
    """

    pose: list[float]
    hand: list[float]
    status: Status
    joint_stiffness: list[float]
    held: list[str]
    scale: float
    matrices: dict[str, list[list[float]]]
    errors: dict[str, float]
    is_exact: bool

    @property
    def ok(self) -> bool:
        """Whether there is a design that can be used; it need not be exact."""
        return self.status in (Status.SOLVED, Status.SINGULAR)

    def as_tables(self) -> dict[str, Any]:
        """Return it for machines."""
        own = {
            name: getattr(self, name) for name in ("pose", "hand", "joint_stiffness", "held", "scale", "is_exact")
        }
        named = {"ok": self.ok, "status": self.status.name.lower(), "meaning": self.status.text}
        return named | own | self.matrices | {"errors": self.errors}

    def as_text(self) -> str:
        """Return it for people."""
        from tuning.cli.options import table

        joints = zip(self.pose, self.joint_stiffness, self.held, strict=True)
        rows = [[i + 1, float(np.rad2deg(q)), k, held] for i, (q, k, held) in enumerate(joints)]
        lines = [table(["joint", "pose [deg]", "stiffness [N·m/rad]", "fit"], rows)]
        for name, matrix in self.matrices.items():
            lines.append(name.replace("_", " "))
            lines += ["  " + "  ".join(f"{value:12.5g}" for value in row) for row in matrix]
        lines += [f"{name.replace('_', ' ')}: {100.0 * value:.4g} %" for name, value in self.errors.items()]
        met = "met exactly" if self.is_exact else "not met exactly"
        lines.append(f"{self.status.text}; the desired stiffness is {met}; passive compliances × {self.scale:.6g}")
        return "\n".join(lines)


@eqx.filter_jit
def _design(problem: ArmProblem, pose: Array) -> tuple[StiffnessDesign, Outcome]:
    return problem.design(pose), problem.outcome(pose)


def design_pose(study: ArmStudy, problem: ArmProblem) -> PoseDesign:
    """Return the design for the study's pose."""
    pose = pose_of(study, problem)
    design, outcome = _design(problem, pose)
    scale = np.asarray(task_scale(study.task.length))[: study.task.size]
    status = Status(int(design.status))
    return PoseDesign(
        [float(v) for v in pose],
        [float(v) for v in outcome.hand],
        status,
        [float(v) for v in design.joint_stiffness],
        [_BOUND[int(v)] for v in design.working],
        float(design.scale),
        {
            name: (np.asarray(getattr(design, name)) * scale[:, None] * scale).tolist()
            for name in _MATRICES
            if not (name == "passive_stiffness" and status == Status.SINGULAR)
        },
        {name: float(value) for name, value in outcome._asdict().items() if name.endswith("_error")},
        bool(design.is_exact),
    )
