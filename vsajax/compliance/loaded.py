"""Joint stiffnesses and controller for a hand that bears a load: the outlook of Petit and Albu-Schäffer.

A force F that keeps its value while the arm moves adds H = −∂(JᵀF)/∂q to the joints' stiffness, the second term of
(1), so that the joints give the hand C_p = J (diag(1/c) + H)⁻¹ Jᵀ instead of (3). At 10 N this changes C_p by a
few percent, at 50 N by up to a third.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from vsajax import numerics, rollout
from vsajax.compliance.active import fit_active
from vsajax.compliance.designer import Status, StiffnessDesign, StiffnessDesigner, is_exactly, refusal
from vsajax.compliance.passive import StiffnessBounds
from vsajax.solvers.spectrum import eigen, inverse

Matrix = Float[Array, "m m"]
Joints = Float[Array, " n"]


def loaded_compliance(
    jacobian: Float[Array, "m n"], compliance: Joints, load_stiffness: Float[Array, "n n"]
) -> Matrix:
    """Return C_p = J (diag(1/c) + H)⁻¹ Jᵀ.

    Args:
        jacobian: J.
        compliance: c [rad/(N·m)].
        load_stiffness: H of a force, symmetric, see `arms.SerialArm.load_stiffness` [N·m/rad].

    Returns:
        C_p [m/N]; NaN where diag(1/c) + H is not positive definite: the load makes the joints give way.
    """
    whole = jnp.diag(1.0 / compliance) + numerics.symmetric_part(load_stiffness)
    is_stable = eigen(whole)[0].min() > 0.0
    kept = inverse(jnp.where(is_stable, whole, jnp.eye(whole.shape[0])))
    return numerics.symmetric_part(jacobian @ kept @ jacobian.T) * jnp.where(is_stable, 1.0, jnp.nan)


def design_loaded(
    designer: StiffnessDesigner,
    jacobian: Float[Array, "m n"],
    desired_stiffness: Matrix,
    bounds: StiffnessBounds,
    load_stiffness: Float[Array, "n n"],
    *,
    iterations: int = 24,
) -> StiffnessDesign:
    """Return joint stiffnesses and controller with which the hand has K_d under the load.

    What the load adds to the compliance of the joints, Δ(c), is taken off what is asked for, and the design
    repeated with the Δ of the last one. The error falls by ‖diag(c) H‖ an iteration.

    Args:
        designer: both stages.
        jacobian: J at the loaded pose.
        desired_stiffness: K_d.
        bounds: of the joints' stiffness.
        load_stiffness: H [N·m/rad].
        iterations: designs made.

    Returns:
        The design, its `passive` and `is_exact` with the load; `Status.UNSTABLE` and NaN where the load makes the
        joints give way, or takes more off the compliance than the task asks for.
    """

    def asked(extra: Matrix) -> Matrix:
        return inverse(inverse(desired_stiffness) - extra)

    def improve(now: tuple[Matrix, StiffnessDesign]) -> tuple[Matrix, StiffnessDesign]:
        design = designer.design(jacobian, asked(now[0]), bounds)
        loaded = loaded_compliance(jacobian, design.joint_compliance, load_stiffness)
        return loaded - design.passive, design

    def blank() -> StiffnessDesign:
        return designer.design(jacobian, desired_stiffness, bounds)

    nothing = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), jax.eval_shape(blank))
    start = jnp.zeros_like(desired_stiffness), nothing
    extra, design = rollout.repeat(improve, start, times=iterations)
    desired = inverse(desired_stiffness)
    passive = design.passive + extra
    active = fit_active(desired, passive, 1.0 / designer.max_active_stiffness)
    is_stable = jnp.isfinite(passive).all()
    # An input that is refused is so from the first design on; what fails later fails for the load.
    refused = refusal(jacobian, desired_stiffness, bounds)
    status = jnp.where(is_stable & (design.status <= Status.NOT_OPTIMAL), design.status, Status.UNSTABLE)
    status = jnp.where(refused > 0, refused, status)
    kept = jnp.where(status <= Status.NOT_OPTIMAL, 1.0, jnp.nan)
    return design._replace(
        joint_compliance=design.joint_compliance * kept,
        scale=design.scale * kept,
        desired=desired * kept,
        passive=passive * kept,
        active=active * kept,
        is_exact=is_exactly(active + passive, desired) & (status <= Status.NOT_OPTIMAL),
        optimality=design.optimality * kept,
        status=status,
    )
