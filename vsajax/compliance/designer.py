"""Both stages together: from a Jacobian and a desired stiffness to joint stiffnesses and a controller."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from vsajax import numerics
from vsajax.compliance.active import Scaling, fit_active, passive_scale
from vsajax.compliance.passive import StiffnessBounds, fit_passive, hand_compliance
from vsajax.solvers.box import AbstractBoxSolver
from vsajax.solvers.interior_point import InteriorPoint
from vsajax.solvers.spectrum import eigen, inverse
from vsajax.types import Scalar, as_leaf

Matrix = Float[Array, "m m"]

_OPTIMAL = 1e-9
_SINGULAR = 1e-10
_SYMMETRIC = 1e-9
_EXACT = 256.0
"""Units of rounding, of ‖C_d‖, that C_a + C_p − C_d may have where the design is exact.

Over 100,000 poses of arms with four and seven joints what was not clipped had at most 10 of them (2.2e-15), and
what was had at least 4,500 (1e-12): a clipped joint leaves an offset that may be arbitrarily small, which a
tolerance like 1e-9 takes for none."""
_ROUNDING = 1e-9


class Status(IntEnum):
    """What became of a design. The first four have an answer; of the others every number is NaN."""

    SOLVED = 0
    SINGULAR = 1
    UNREACHABLE = 2
    NOT_OPTIMAL = 3
    NOT_FINITE = 4
    BAD_BOUNDS = 5
    NOT_DEFINITE = 6
    UNSTABLE = 7

    @property
    def text(self) -> str:
        """What it means."""
        return _TEXTS[self]


_TEXTS = {
    Status.SOLVED: "solved",
    Status.SINGULAR: "the pose is singular: the joints leave the hand rigid in some direction, and the passive "
    "stiffness is infinite there; compliances and the serial stiffness are finite",
    Status.UNREACHABLE: "the desired stiffness is above the largest active stiffness in some direction: no design "
    "can meet it",
    Status.NOT_OPTIMAL: "the solver stopped before the optimum, e.g. as the printed active set cycles",
    Status.NOT_FINITE: "a Jacobian, stiffness or bound is NaN or infinite",
    Status.BAD_BOUNDS: "the bounds of a joint's stiffness do not satisfy 0 < lower ≤ upper",
    Status.NOT_DEFINITE: "the desired stiffness is not symmetric positive definite",
    Status.UNSTABLE: "under the load the joints give way, or the load alone is softer than the task asks for",
}


class StiffnessDesign(NamedTuple):
    """Joint stiffnesses and controller for one pose.

    Args:
        joint_compliance: c [rad/(N·m)].
        working: −1 where the fit held a joint at its stiffest, +1 at its softest, 0 free; before scaling.
        scale: factor on the compliances of the fit, before they were clipped to the bounds.
        desired: C_d.
        passive: C_p, compliance of the hand by the joints alone.
        active: C_a, the controller's compliance.
        is_exact: whether C_a + C_p = C_d, to 256 units of rounding of its norm.
        optimality: of the passive fit, see `BoxSolution`.
        status: a `Status`.
    """

    joint_compliance: Float[Array, " n"]
    working: Float[Array, " n"]
    scale: Scalar
    desired: Matrix
    passive: Matrix
    active: Matrix
    is_exact: Bool[Array, ""]
    optimality: Scalar
    status: Int[Array, ""]

    @property
    def joint_stiffness(self) -> Float[Array, " n"]:
        """The joints' stiffness [N·m/rad]."""
        return 1.0 / self.joint_compliance

    @property
    def serial(self) -> Matrix:
        """C_s = C_a + C_p, the compliance of the hand, eq. (7)."""
        return self.active + self.passive

    @property
    def desired_stiffness(self) -> Matrix:
        """K_d."""
        return inverse(self.desired)

    @property
    def active_stiffness(self) -> Matrix:
        """K_a, the gain of the controller (12)."""
        return inverse(self.active)

    @property
    def serial_stiffness(self) -> Matrix:
        """K_s, the stiffness of the hand, eq. (6)."""
        return inverse(self.serial)

    @property
    def passive_stiffness(self) -> Matrix:
        """K_p; NaN where the pose is singular."""
        return jnp.where(self.status == Status.SINGULAR, jnp.nan, inverse(self.passive))


class StiffnessDesigner(eqx.Module):
    """Passive fit, scaling, active fit.

    Args:
        max_active_stiffness: 1/0⁺, the stiffest controller in any direction [N/m].
        solver: of the passive fit.
        scaling: see `passive_scale`.
        clip: whether scaled compliances are put back between the bounds. The paper does not say; without it joints
            would have to be stiffer than they can, with it exactness is lost where they would.
        weights: G of the passive fit, or `None` for all ones.
    """

    max_active_stiffness: Scalar = eqx.field(converter=as_leaf, default=4545.0)
    solver: AbstractBoxSolver = InteriorPoint()
    scaling: Scaling = eqx.field(static=True, default="exact")
    clip: bool = eqx.field(static=True, default=True)
    weights: Matrix | None = None

    def design(
        self, jacobian: Float[Array, "m n"], desired_stiffness: Matrix, bounds: StiffnessBounds
    ) -> StiffnessDesign:
        """Return joint stiffnesses and controller for one pose.

        Pure, of a fixed number of operations, differentiable but where an eigenvalue or a multiplier changes
        sides.

        Args:
            jacobian: J; for a 6 × 6 stiffness in scaled coordinates, see `arms.scaled_rows`.
            desired_stiffness: K_d, in the same coordinates.
            bounds: of the joints' stiffness.
        """
        floor = 1.0 / self.max_active_stiffness
        refused = refusal(jacobian, desired_stiffness, bounds)
        # What is refused is replaced by something harmless, so that no NaN reaches a derivative of the others.
        safe_jacobian = jnp.where(refused > 0, 1.0, jacobian)
        safe_desired = jnp.where(refused > 0, jnp.eye(desired_stiffness.shape[0]), desired_stiffness)
        safe_bounds = StiffnessBounds(*(jnp.where(refused > 0, 1.0, bound) for bound in bounds))
        desired = inverse(safe_desired)
        fit = fit_passive(safe_jacobian, desired, safe_bounds, self.solver, self.weights)
        scale = passive_scale(self.scaling, desired, hand_compliance(safe_jacobian, fit.compliance), floor)
        is_reachable = jnp.isfinite(scale)
        # The exact scale is finite only where C_d − 0⁺ I is definite, which says the same.
        if self.scaling != "exact":
            is_reachable = is_reachable & (eigen(desired)[0].min() >= floor * (1.0 - _ROUNDING))
        scale = jnp.where(jnp.isfinite(scale), scale, 1.0)
        compliance = scale * fit.compliance
        if self.clip:
            compliance = jnp.clip(compliance, 1.0 / safe_bounds.upper, 1.0 / safe_bounds.lower)
        passive = hand_compliance(safe_jacobian, compliance)
        active = fit_active(desired, passive, floor)
        spread = eigen(passive)[0]
        status = jnp.where(spread.min() <= _SINGULAR * spread.max(), Status.SINGULAR, Status.SOLVED)
        status = jnp.where(is_reachable, status, Status.UNREACHABLE)
        status = jnp.where(fit.optimality <= _OPTIMAL, status, Status.NOT_OPTIMAL)
        status = jnp.where(refused > 0, refused, status)
        blank = jnp.where(refused > 0, jnp.nan, 1.0)
        return StiffnessDesign(
            compliance * blank,
            fit.working,
            scale * blank,
            desired * blank,
            passive * blank,
            active * blank,
            is_exactly(active + passive, desired) & (refused == 0),
            fit.optimality * blank,
            status,
        )


def is_exactly(compliance: Matrix, desired: Matrix) -> Bool[Array, ""]:
    """Return whether a compliance is the desired one but for rounding."""
    offset, size = (jnp.sqrt((matrix**2).sum()) for matrix in (compliance - desired, desired))
    return offset <= _EXACT * jnp.finfo(desired.dtype).eps * size


def refusal(jacobian: Float[Array, "m n"], stiffness: Matrix, bounds: StiffnessBounds) -> Int[Array, ""]:
    """Return the status of an input that has no answer, and 0 for any other."""
    is_finite = jnp.isfinite(jacobian).all() & jnp.isfinite(stiffness).all()
    is_finite = is_finite & jnp.isfinite(bounds.lower).all() & jnp.isfinite(bounds.upper).all()
    ordered = ((bounds.lower > 0.0) & (bounds.lower <= bounds.upper)).all()
    checked = jnp.where(is_finite, stiffness, jnp.eye(stiffness.shape[0]))
    values = eigen(numerics.symmetric_part(checked))[0]
    largest = jnp.abs(checked).max()
    is_symmetric = jnp.abs(checked - checked.T).max() <= _SYMMETRIC * largest
    is_definite = is_symmetric & (values.min() > 1e-12 * largest)
    status = jnp.where(is_definite, 0, Status.NOT_DEFINITE)
    status = jnp.where(ordered, status, Status.BAD_BOUNDS)
    return jnp.where(is_finite, status, Status.NOT_FINITE)


class StiffnessErrors(NamedTuple):
    """How far a compliance is from the desired one, relative Frobenius norms, dimensionless.

    Never judge by one alone: a fit in compliance that is good to 60 % can be off by 1000 % as a stiffness.

    Args:
        stiffness: ‖K − K_d‖ / ‖K_d‖.
        compliance: ‖C − C_d‖ / ‖C_d‖.
    """

    stiffness: Scalar
    compliance: Scalar


def stiffness_errors(compliance: Matrix, desired: Matrix) -> StiffnessErrors:
    """Return both errors of a compliance against the desired one."""

    def relative(ours: Matrix, wanted: Matrix) -> Scalar:
        return jnp.sqrt(((ours - wanted) ** 2).sum() / (wanted**2).sum())

    return StiffnessErrors(relative(inverse(compliance), inverse(desired)), relative(compliance, desired))
