"""The arm of a study, from joint positions to a design: for one pose and for very many."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from tuning.files.errors import InputError
from tuning.kinds.arm.kinematics import chain_of
from tuning.kinds.arm.robots import arm_of
from tuning.kinds.arm.study import ArmStudy, check_joints
from vsajax import rollout
from vsajax.arms import SerialArm, scaled_rows, task_scale
from vsajax.control import (
    Status,
    StiffnessBounds,
    StiffnessDesign,
    StiffnessDesigner,
    design_loaded,
    hand_compliance,
    loaded_compliance,
    stiffness_errors,
)

Joints = Float[Array, " joints"]


class PoseOutcome(NamedTuple):
    """What a pose allows.

    Args:
        hand: its position [m].
        joint_stiffness: [N·m/rad].
        scale: factor on the passive compliances.
        passive_stiffness_error: relative, of the joints alone.
        passive_compliance_error: the same as compliances.
        stiffness_error: relative, of joints and controller.
        compliance_error: the same as compliances.
        passive_share: tr C_p / tr C_d.
        is_exact: whether the desired stiffness is met.
        status: see `Status`.
    """

    hand: Float[Array, "3"]
    joint_stiffness: Joints
    scale: Float[Array, ""]
    passive_stiffness_error: Float[Array, ""]
    passive_compliance_error: Float[Array, ""]
    stiffness_error: Float[Array, ""]
    compliance_error: Float[Array, ""]
    passive_share: Float[Array, ""]
    is_exact: Array
    status: Int[Array, ""]


class ArmBench(eqx.Module):
    """The arm, what its hand should be like, and how that is designed.

    Args:
        arm: kinematics.
        ranges: of the joints [rad].
        drawn: where the search of poses draws its targets and starts [rad].
        desired: K_d in the task's coordinates [N/m].
        bounds: of the joints' stiffness.
        designer: both stages.
        length: at which a rotation counts as a displacement [m].
        load: on the hand, or `None` [N].
        names: of the joints, in the order of every number that there is one of a joint.
    """

    arm: SerialArm
    ranges: Float[Array, "joints 2"]
    drawn: Float[Array, "joints 2"]
    desired: Float[Array, "m m"]
    bounds: StiffnessBounds
    designer: StiffnessDesigner
    length: Float[Array, ""]
    load: Float[Array, "3"] | None = None
    names: tuple[str, ...] = eqx.field(static=True, default=())

    def with_values(self, values: Mapping[str, Array]) -> ArmBench:
        """Return the bench with numbers at dotted paths of the study replaced."""
        if not values:
            return self
        places = [NUMBERS[path] for path in values]
        given = zip(places, values.values(), strict=True)
        leaves = [jnp.broadcast_to(value, place(self).shape) for place, value in given]
        return eqx.tree_at(lambda bench: [place(bench) for place in places], self, leaves)

    def jacobian(self, positions: Joints) -> Float[Array, "m joints"]:
        """Return J in the task's coordinates, rotations scaled to displacements."""
        whole = scaled_rows(self.arm.jacobian(positions), self.length)
        return whole[: self.desired.shape[0]]

    def design(self, positions: Joints) -> StiffnessDesign:
        """Return joints and controller for a pose, under the load if there is one."""
        jacobian = self.jacobian(positions)
        if self.load is None:
            return self.designer.design(jacobian, self.desired, self.bounds)
        load = self.arm.load_stiffness(positions, self._wrench())
        return design_loaded(self.designer, jacobian, self.desired, self.bounds, load)

    def passive(self, positions: Joints, compliance: Joints) -> Float[Array, "m m"]:
        """Return the hand's compliance by joints of some compliance alone, under the load if there is one."""
        if self.load is None:
            return hand_compliance(self.jacobian(positions), compliance)
        load = self.arm.load_stiffness(positions, self._wrench())
        return loaded_compliance(self.jacobian(positions), compliance, load)

    def _wrench(self) -> Float[Array, "6"]:
        return jnp.concatenate([jnp.asarray(self.load), jnp.zeros(3)])

    def outcome(self, positions: Joints) -> PoseOutcome:
        """Return what a pose allows."""
        design = self.design(positions)
        both = jnp.stack([design.passive, design.serial])
        errors = jax.vmap(stiffness_errors, (0, None))(both, design.desired)
        # A singular pose is infinitely stiff in some direction: the passive error as a stiffness has no value.
        passive_stiffness = jnp.where(design.status == Status.SINGULAR, jnp.nan, errors.stiffness[0])
        return PoseOutcome(
            self.arm.forward(positions).position,
            design.joint_stiffness,
            design.scale,
            passive_stiffness,
            errors.compliance[0],
            errors.stiffness[1],
            errors.compliance[1],
            jnp.trace(design.passive) / jnp.trace(design.desired),
            design.is_exact,
            design.status,
        )

    def draw(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Return joint positions drawn evenly from the joints' ranges, `(count, joints)` [rad]."""
        return _uniform(rng, self.ranges, count)

    def draw_starts(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Return joint positions for the search of poses, as `draw` does from `drawn`."""
        return _uniform(rng, self.drawn, count)


NUMBERS: Mapping[str, Callable[[ArmBench], Any]] = {
    "joints.lower": lambda bench: bench.bounds.lower,
    "joints.upper": lambda bench: bench.bounds.upper,
    "controller.max_stiffness": lambda bench: bench.designer.max_active_stiffness,
}
"""Where the numbers of a study that can be varied stand in its bench."""


def _uniform(rng: np.random.Generator, ranges: Array, count: int) -> np.ndarray:
    low, high = np.asarray(ranges).T
    return rng.uniform(low, high, (count, low.size))


@eqx.filter_jit
def outcomes(bench: ArmBench, positions: Float[Array, "poses joints"]) -> PoseOutcome:
    """Return what many poses allow, on all cores."""
    arrays, rest = eqx.partition(bench, eqx.is_array)
    return rollout.map_lanes(lambda q, shared: eqx.combine(shared, rest).outcome(q), positions, arrays)


USABLE = (Status.SOLVED, Status.SINGULAR)
"""Of a design that meets its task as far as the joints can."""


def usable(outcome: PoseOutcome) -> np.ndarray:
    """Return which of many outcomes have a design that can be used: finite, for a task that can be met."""
    met = np.isin(outcome.status, USABLE)
    numbers = np.column_stack([outcome.joint_stiffness, outcome.compliance_error, outcome.stiffness_error])
    return met & np.isfinite(numbers).all(1)


def told_statuses(status: np.ndarray) -> str:
    """Return what became of many poses, the commonest first, in words."""
    kinds, counts = np.unique(np.asarray(status, int), return_counts=True)
    order = np.argsort(-counts, kind="stable")
    return "; ".join(f"{counts[i]} of {np.size(status)}: {Status(int(kinds[i])).text}" for i in order)


def build_bench(study: ArmStudy, place: Path | str) -> ArmBench:
    """Return the bench of a study; `place` is its file, for errors.

    Raises:
        InputError: the URDF cannot be read, or numbers do not fit its joints.
    """
    chain = chain_of(study.arm, str(place), study.folder)
    mistakes = check_joints(study, chain, str(place))
    if mistakes:
        raise InputError(*mistakes)
    drawn = np.deg2rad(study.poses.drawn_deg) if study.poses.drawn_deg else chain.ranges
    every = jnp.ones(chain.joints)
    scale = task_scale(study.task.length)[: study.task.size]
    controller = study.controller
    return ArmBench(
        arm_of(chain),
        jnp.asarray(chain.ranges),
        jnp.asarray(drawn),
        jnp.asarray(study.task.matrix()) / (scale[:, None] * scale),
        StiffnessBounds(jnp.asarray(study.joints.lower) * every, jnp.asarray(study.joints.upper) * every),
        StiffnessDesigner(controller.max_stiffness, scaling=controller.scaling, clip=controller.clip),
        jnp.asarray(study.task.length),
        jnp.asarray(study.task.load) if any(study.task.load) else None,
        chain.names,
    )


def pose_of(study: ArmStudy, bench: ArmBench) -> jax.Array:
    """Return the study's pose [rad], by default the middle of the joints' ranges."""
    if study.arm.pose_deg:
        return jnp.deg2rad(jnp.asarray(study.arm.pose_deg))
    return bench.ranges.mean(1)
