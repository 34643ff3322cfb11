"""The active stage: the controller's compliance, and how much of the passive one leaves room for it.

Petit, Albu-Schäffer, Sections V and VI-C. The compliances add up, C_s = C_a + C_p (7); C_a must be positive
definite and no smaller than 0⁺, the compliance of the stiffest controller that is allowed.
"""

from __future__ import annotations

from typing import Literal

import jax.numpy as jnp
from jaxtyping import Array, Float

from vsajax.solvers.spectrum import floored, largest_generalised_eigenvalue
from vsajax.types import Scalar

Matrix = Float[Array, "m m"]
Scaling = Literal["none", "printed", "exact"]


def fit_active(desired: Matrix, passive: Matrix, floor: Scalar) -> Matrix:
    """Return the C_a nearest to C_d − C_p whose eigenvalues are at least 0⁺, eqs. (13)–(14).

    Printed is: keep λ > 0, else 0⁺. That leaves 0 < λ < 0⁺ and with it controllers up to 10¹⁷ N/m; here it is
    max(λ, 0⁺). Printed are also C_Q = V C_a Vᵀ and C_a = Vᵀ C_Q V; with X = V Λ Vᵀ it must be the reverse.

    Args:
        desired: C_d [m/N].
        passive: C_p [m/N].
        floor: 0⁺ [m/N].
    """
    return floored(desired - passive, floor)


def passive_scale(scaling: Scaling, desired: Matrix, passive: Matrix, floor: Scalar) -> Scalar:
    """Return the factor on the passive compliances that leaves room for the active one.

    At the optimum of (9) every free joint has Jᵢᵀ (C_d − C_p) Jᵢ = 0, so that C_d − C_p is never positive definite
    unless all joints are at their bounds: without scaling the offset is structural.

    Args:
        scaling: "none"; "printed", (18), 1/λ_max(C_p, C_d), which puts an eigenvalue of C_a at exactly 0 and so
            keeps an offset, and stiffens nothing but softens where λ_max < 1; or "exact", min(1, 1/λ_max(C_p, C_d
            − 0⁺ I)), with which C_s = C_d.
        desired: C_d.
        passive: C_p.
        floor: 0⁺.

    Returns:
        The factor; NaN for "exact" where C_d − 0⁺ I is not positive definite, as no controller that is allowed is
        stiff enough.
    """
    if scaling == "none":
        return jnp.ones(())
    if scaling == "printed":
        return 1.0 / largest_generalised_eigenvalue(passive, desired)
    room = desired - floor * jnp.eye(desired.shape[0])
    return 1.0 / jnp.maximum(largest_generalised_eigenvalue(passive, room), 1.0)
