"""The design for one pose, told in full."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array

from tuning.kinds.arm.bench import ArmBench, PoseOutcome, pose_of
from tuning.kinds.arm.names import shown
from tuning.kinds.arm.study import ArmStudy
from vsajax.arms import task_scale
from vsajax.control import Status, StiffnessDesign

_MATRICES = ("passive_stiffness", "active_stiffness", "serial_stiffness")
_BOUND = {-1: "upper", 0: "free", 1: "lower"}


@dataclass(frozen=True)
class PoseDesign:
    """What to set the joints and the controller to at a pose, and what the hand then has.

    Args:
        joints: their names, in the order of every list that has one number a joint.
        pose: [rad].
        outside: a sentence for each joint that the pose puts outside of its range.
        hand: position [m].
        status: whether it can be met.
        joint_stiffness: [N·m/rad].
        held: for each joint, whether the fit held its stiffness at "lower" or "upper", or left it "free".
        scale: factor on the passive compliances.
        matrices: passive, active, serial stiffness in the task's units [N/m], [N], [N·m/rad].
        errors: relative, by name; NaN where the pose has none.
        is_exact: whether the desired stiffness is met.
    """

    joints: list[str]
    pose: list[float]
    outside: list[str]
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
        return self.is_told and self.status in (Status.SOLVED, Status.SINGULAR)

    @property
    def is_told(self) -> bool:
        """Whether the design has numbers."""
        numbers = [*self.joint_stiffness, self.scale, *np.ravel(list(self.matrices.values()))]
        return bool(np.isfinite(numbers).all())

    @property
    def meaning(self) -> str:
        """What became of the design."""
        if self.is_told or self.status not in (Status.SOLVED, Status.SINGULAR):
            return self.status.text
        return "the numbers of the study are so large or small that the design overflows"

    def as_tables(self) -> dict[str, Any]:
        """Return it for machines."""
        own = {
            name: getattr(self, name)
            for name in ("joints", "pose", "outside", "hand", "joint_stiffness", "held", "scale", "is_exact")
        }
        named = {"ok": self.ok, "status": self.status.name.lower(), "meaning": self.meaning}
        return named | own | self.matrices | {"errors": self.errors}

    def as_text(self) -> str:
        """Return it for people."""
        from tuning.terminal.options import table

        notes = [f"note: {sentence}" for sentence in self.outside]
        angles = [float(np.rad2deg(q)) for q in self.pose]
        names = [shown(name) for name in self.joints]
        if not self.is_told:
            rows = [list(row) for row in zip(names, angles, strict=True)]
            return "\n".join([table(["joint", "pose [deg]"], rows), *notes, f"no design: {self.meaning}"])
        rows = [list(row) for row in zip(names, angles, self.joint_stiffness, self.held, strict=True)]
        lines = [table(["joint", "pose [deg]", "stiffness [N·m/rad]", "fit"], rows), *notes]
        for name, matrix in self.matrices.items():
            lines.append(name.replace("_", " "))
            lines += ["  " + "  ".join(f"{value:12.5g}" for value in row) for row in matrix]
        lines += [f"{name.replace('_', ' ')}: {self._error(value)}" for name, value in self.errors.items()]
        met = "met exactly" if self.is_exact else "not met exactly"
        lines.append(f"{self.meaning}; the desired stiffness is {met}; passive compliances × {self.scale:.6g}")
        return "\n".join(lines)

    def _error(self, value: float) -> str:
        if np.isfinite(value):
            return f"{100.0 * value:.4g} %"
        why = "the pose is singular" if self.status == Status.SINGULAR else "beyond what a number can hold"
        return f"none, {why}"


@eqx.filter_jit
def _design(bench: ArmBench, pose: Array) -> tuple[StiffnessDesign, PoseOutcome]:
    return bench.design(pose), bench.outcome(pose)


def design_pose(study: ArmStudy, bench: ArmBench, outside: Sequence[str] = ()) -> PoseDesign:
    """Return the design for the study's pose; `outside` says which joints that puts outside of their ranges."""
    pose = pose_of(study, bench)
    design, outcome = _design(bench, pose)
    scale = np.asarray(task_scale(study.task.length))[: study.task.size]
    status = Status(int(design.status))
    return PoseDesign(
        list(bench.names),
        [float(v) for v in pose],
        list(outside),
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
