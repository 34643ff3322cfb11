"""Registries of estimator parts, and small regressions shared by the tests."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from tests.vsajax.builders import paper_basis
from vsajax import rollout
from vsajax.estimators import (
    ConstantFactor,
    EnhancedFactor,
    ExponentialForgetting,
    Legendre,
    Polynomial,
    RecursiveLeastSquares,
    SeparableOddPolynomial,
    Taylor,
    UnitFactor,
)
from vsajax.estimators.rls import FitState

BASES = {
    "paper": paper_basis(),
    "scaled": SeparableOddPolynomial(0.2, 1.0, 0.5, deflection_terms=3, setpoint_terms=2),
    "offset": SeparableOddPolynomial(0.2, deflection_terms=3, deflection_offset=True),
    "bias": SeparableOddPolynomial(0.2, deflection_terms=3, torque_bias=True),
    "offset and bias": SeparableOddPolynomial(
        0.2, 1.0, 0.5, deflection_terms=2, setpoint_terms=2, deflection_offset=True, torque_bias=True
    ),
    "polynomial": Polynomial(0.2, order=5),
    "line": Polynomial(0.2),
    "taylor": Taylor(0.2, order=3),
    "legendre": Legendre(-0.25, 0.15, order=7),
}

LAWS = {
    "unit": UnitFactor(),
    "enhanced": EnhancedFactor(1e-3),
    "constant": ConstantFactor(0.4),
    "forgetting": ExponentialForgetting(0.97),
}


@eqx.filter_jit
def run_fit(
    fit: RecursiveLeastSquares, features: np.ndarray, targets: np.ndarray, blend: float = 1.0
) -> tuple[FitState, jax.Array, jax.Array]:
    """Return the last state, and the coefficients and stability factors after every sample."""

    def step(state: FitState, inputs: tuple[jax.Array, jax.Array]):
        row, target = inputs
        state, factor = fit.step(state, row, target, blend=blend)
        return state, (state.coefficients, factor)

    inputs = (jnp.asarray(features), jnp.asarray(targets))
    state, (coefficients, factors) = rollout.scan(step, fit.init(features.shape[1]), inputs)
    return state, coefficients, factors


def regression(*, samples: int = 300, size: int = 4, noise: float = 0.1) -> tuple[np.ndarray, np.ndarray]:
    """Return well-scaled features and noisy targets."""
    rng = np.random.default_rng(7)
    features = rng.normal(size=(samples, size))
    return features, features @ np.arange(1.0, size + 1.0) + noise * rng.normal(size=samples)
