"""Regression bases: functions of deflection and setpoint whose weighted sum is the elastic torque.

Letters: F features with τ_e = Fᵀη, ∂F/∂φ their slopes with σ = (∂F/∂φ)ᵀη; φ deflection, θ_c setpoint.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Literal

import equinox as eqx
import jax.numpy as jnp

from vsajax.numerics import Vector, lanes_minor
from vsajax.types import Scalar, as_leaf


class AbstractBasis(eqx.Module):
    """Features of the elastic torque, linear in the unknown coefficients."""

    @property
    @abstractmethod
    def size(self) -> int:
        """Number of features d."""

    @property
    @abstractmethod
    def uses_setpoint(self) -> bool:
        """Whether the features depend on the setpoint, which must then be measured."""

    @abstractmethod
    def __call__(self, setpoint: Scalar, deflection: Scalar) -> tuple[Vector, Vector]:
        """Return the features F and their slopes ∂F/∂φ."""


class SeparableOddPolynomial(AbstractBasis):
    """Products of powers of the setpoint and odd powers of the deflection, (18)–(23) of Flacco et al., IROS 2011.

    F = (s^j x^(2i+1)) for j < m (outer) and i < n (inner), with x = φ / deflection_scale and
    s = setpoint_origin + setpoint_scale · θ_c in `setpoint_unit`. The RLS prior acts on the coefficients of these
    features, so units and scales decide how fast each of them is learnt: for the AwAS, the paper's figures need
    the lever arm s = r₀ + b θ_c in millimetres.

    With `deflection_offset` the even powers x^(2i) join: the powers of (φ − φ₀) span the same space for any
    offset φ₀ of the encoders, so an unknown φ₀, and with it a torque bias, is identified by the same linear fit.

    Args:
        deflection_scale: [rad].
        setpoint_origin: s at θ_c = 0 [rad, or m for a lever arm].
        setpoint_scale: change of s per radian of θ_c [1, or m/rad].
        deflection_terms: n ≥ 1.
        setpoint_terms: m ≥ 1; with 1 the setpoint is not used.
        setpoint_unit: of s in the features: "rad", "m" or "mm".
        deflection_offset: whether to identify an offset of the deflection.
        torque_bias: whether to identify a bias of the torque signal, by the constant feature 1.
    """

    deflection_scale: Scalar = eqx.field(converter=as_leaf, default=1.0)
    setpoint_origin: Scalar = eqx.field(converter=as_leaf, default=0.0)
    setpoint_scale: Scalar = eqx.field(converter=as_leaf, default=1.0)
    deflection_terms: int = eqx.field(static=True, default=1)
    setpoint_terms: int = eqx.field(static=True, default=1)
    setpoint_unit: Literal["rad", "m", "mm"] = eqx.field(static=True, default="rad")
    deflection_offset: bool = eqx.field(static=True, default=False)
    torque_bias: bool = eqx.field(static=True, default=False)

    @property
    def size(self) -> int:
        """Return n m, twice that with an offset, and one more for a bias."""
        products = self.deflection_terms * self.setpoint_terms
        return products * (2 if self.deflection_offset else 1) + self._has_constant

    @property
    def uses_setpoint(self) -> bool:
        """Return whether m > 1."""
        return self.setpoint_terms > 1

    def __call__(self, setpoint: Scalar, deflection: Scalar) -> tuple[Vector, Vector]:
        """Return the features and their slopes."""
        powers = _powers(deflection / self.deflection_scale, 2 * self.deflection_terms - 1)
        exponents = [2 * i + 1 for i in range(self.deflection_terms)]
        if self.deflection_offset:
            exponents += [2 * i for i in range(self.deflection_terms)]
        inner = _vector([powers[e] for e in exponents])
        slopes = _vector([e * powers[max(e - 1, 0)] / self.deflection_scale for e in exponents])
        unit = 1000.0 if self.setpoint_unit == "mm" else 1.0
        lever = unit * (self.setpoint_origin + self.setpoint_scale * setpoint)
        outer = _vector(_powers(lever, self.setpoint_terms - 1))
        features = (outer[:, None] * inner[None, :]).reshape(-1)
        derivatives = (outer[:, None] * slopes[None, :]).reshape(-1)
        if self._has_constant:
            features, derivatives = jnp.append(features, 1.0), jnp.append(derivatives, 0.0)
        return lanes_minor(features), lanes_minor(derivatives)

    @property
    def _has_constant(self) -> bool:
        # The even powers of an offset start with the constant already.
        return self.torque_bias and not self.deflection_offset


class Polynomial(AbstractBasis):
    """1, x, …, x^order with x = φ / deflection_scale: a characteristic without symmetry, with its torque bias.

    Args:
        deflection_scale: [rad].
        order: ≥ 1.
    """

    deflection_scale: Scalar = eqx.field(converter=as_leaf, default=1.0)
    order: int = eqx.field(static=True, default=1)

    @property
    def size(self) -> int:
        """Return order + 1."""
        return self.order + 1

    @property
    def uses_setpoint(self) -> bool:
        """Return False."""
        return False

    def __call__(self, setpoint: Scalar, deflection: Scalar) -> tuple[Vector, Vector]:
        """Return the features and their slopes."""
        powers = _powers(deflection / self.deflection_scale, self.order)
        slopes = [jnp.zeros_like(deflection)]
        slopes += [e * powers[e - 1] / self.deflection_scale for e in range(1, self.order + 1)]
        return _vector(powers), _vector(slopes)


class Taylor(AbstractBasis):
    """φ, φ²/2!, …, φ^(order+1)/(order+1)!: a stiffness of the given Taylor order, (18) of Ménard, Grioli, Bicchi.

    Args:
        deflection_scale: φ is taken in this unit [rad].
        order: k ≥ 0 of the stiffness; there are k + 1 features.
    """

    deflection_scale: Scalar = eqx.field(converter=as_leaf, default=1.0)
    order: int = eqx.field(static=True, default=2)

    @property
    def size(self) -> int:
        """Return order + 1."""
        return self.order + 1

    @property
    def uses_setpoint(self) -> bool:
        """Return False."""
        return False

    def __call__(self, setpoint: Scalar, deflection: Scalar) -> tuple[Vector, Vector]:
        """Return the features and their slopes."""
        powers = _powers(deflection / self.deflection_scale, self.order + 1)
        terms = [power / math.factorial(i) for i, power in enumerate(powers)]
        return _vector(terms[1:]), _vector([term / self.deflection_scale for term in terms[:-1]])


class Legendre(AbstractBasis):
    """Legendre polynomials P₀ … P_order of the deflection mapped from [lower, upper] to [−1, 1].

    They keep the regression well conditioned at high orders as long as the deflection stays in the range.

    Args:
        lower: [rad].
        upper: [rad], above `lower`.
        order: ≥ 1.
    """

    lower: Scalar = eqx.field(converter=as_leaf)
    upper: Scalar = eqx.field(converter=as_leaf)
    order: int = eqx.field(static=True, default=3)

    @property
    def size(self) -> int:
        """Return order + 1."""
        return self.order + 1

    @property
    def uses_setpoint(self) -> bool:
        """Return False."""
        return False

    def __call__(self, setpoint: Scalar, deflection: Scalar) -> tuple[Vector, Vector]:
        """Return the features and their slopes."""
        stretch = 2.0 / (self.upper - self.lower)
        x = (deflection - self.lower) * stretch - 1.0
        values, slopes = [jnp.ones_like(x), x], [jnp.zeros_like(x), jnp.ones_like(x)]
        for n in range(1, self.order):
            # Bonnet's recursion, and P'ₙ₊₁ = P'ₙ₋₁ + (2n + 1) Pₙ.
            values.append(((2 * n + 1) * x * values[n] - n * values[n - 1]) / (n + 1))
            slopes.append(slopes[n - 1] + (2 * n + 1) * values[n])
        return _vector(values), _vector([stretch * s for s in slopes])


def _powers(x: Scalar, highest: int) -> list[Scalar]:
    powers = [jnp.ones_like(x)]
    for _ in range(highest):
        powers.append(powers[-1] * x)
    return powers


def _vector(entries: list[Scalar]) -> Vector:
    return lanes_minor(jnp.stack(entries))
