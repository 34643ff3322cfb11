"""Mechanisms that swing on springs: one link, or a planar arm of up to three."""

from __future__ import annotations

from abc import abstractmethod
from itertools import pairwise

import equinox as eqx
import jax.numpy as jnp

from vsajax import numerics
from vsajax.plants.bodies import Link
from vsajax.types import Scalar, as_leaf, optional_leaf

Vector = tuple[Scalar, ...]


class AbstractMechanism(eqx.Module):
    """Rigid links on revolute joints, with friction and gravity, but without the springs."""

    @property
    @abstractmethod
    def joints(self) -> int:
        """How many joints there are."""

    @abstractmethod
    def accelerations(self, positions: Vector, velocities: Vector, torques: Vector) -> Vector:
        """Return the joints' accelerations under joint torques [rad/s²]."""

    @abstractmethod
    def kick(self, positions: Vector, impulses: Vector) -> Vector:
        """Return the jump of the velocities under joint impulses [N·m·s]: M⁻¹ p [rad/s]."""

    @abstractmethod
    def energy(self, positions: Vector, velocities: Vector) -> Scalar:
        """Return the kinetic energy plus that of gravity, 0 at rest with the links hanging down [J]."""


class SingleLink(AbstractMechanism):
    """One link on one joint: I q̈ + b q̇ + g sin q + dry friction = torque.

    Args:
        link: its inertia, friction and load.
    """

    link: Link

    @property
    def joints(self) -> int:
        """One."""
        return 1

    def accelerations(self, positions: Vector, velocities: Vector, torques: Vector) -> Vector:
        """Return the link's acceleration."""
        (position,), (velocity,), (torque,) = positions, velocities, torques
        link = self.link
        drag = link.damping * velocity
        if link.friction is not None:
            drag = drag + link.friction(velocity)
        return ((torque - drag - link.load(position)) * (1.0 / link.inertia),)

    def kick(self, positions: Vector, impulses: Vector) -> Vector:
        """Return p / I."""
        return (impulses[0] / self.link.inertia,)

    def energy(self, positions: Vector, velocities: Vector) -> Scalar:
        """Return ½ I q̇² + g (1 − cos q)."""
        kinetic = 0.5 * self.link.inertia * velocities[0] ** 2
        gravity = self.link.gravity
        return kinetic if gravity is None else kinetic + gravity * (1.0 - numerics.cos(positions[0]))


class ArmLink(eqx.Module):
    """One link of a planar arm.

    Args:
        mass: [kg].
        length: from its joint to the next, or to the tip [m].
        centre: from its joint to its centre of mass [m].
        inertia: about its centre of mass [kg·m²].
        damping: viscous friction of its joint [N·m·s/rad].
    """

    mass: Scalar = eqx.field(converter=as_leaf)
    length: Scalar = eqx.field(converter=as_leaf)
    centre: Scalar = eqx.field(converter=as_leaf)
    inertia: Scalar = eqx.field(converter=as_leaf)
    damping: Scalar = eqx.field(converter=as_leaf, default=0.0)


class PlanarArm(AbstractMechanism):
    """A planar arm of one to three links, M(q) q̈ + C(q, q̇) q̇ + G(q) + B q̇ = torques, (1) of Gasparri et al.

    The sums are taken over absolute angles φᵢ = q₁ + … + qᵢ, where both M and C are short: with
    wⱼ = mⱼ cⱼ + lⱼ Σ_{k>j} m_k the kinetic energy is ½ Σᵢⱼ Aᵢⱼ cos(φᵢ − φⱼ) φ̇ᵢ φ̇ⱼ, where Aᵢⱼ = lᵢ wⱼ for i < j.
    Joint torques τᵢ act on them as τᵢ − τᵢ₊₁. Printed Ṁ = 2 C q̇ has no dimension that fits; what the proof of (25)
    uses is q̇ᵀ(Ṁ − 2C)q̇ = 0.

    Args:
        links: from the base to the tip.
        gravity: [m/s²], the arm hanging down at q = 0; `None` where it moves in a horizontal plane.
    """

    links: tuple[ArmLink, ...]
    gravity: Scalar | None = eqx.field(converter=optional_leaf, default=None)

    def __check_init__(self):
        """Refuse arms whose equations are not written out."""
        if not 1 <= len(self.links) <= 3:
            raise ValueError(f"a planar arm has one to three links; got {len(self.links)}")

    @property
    def joints(self) -> int:
        """One a link."""
        return len(self.links)

    def accelerations(self, positions: Vector, velocities: Vector, torques: Vector) -> Vector:
        """Return the joints' accelerations."""
        angles, rates = _sums(positions), _sums(velocities)
        pull = [t - link.damping * v for t, link, v in zip(torques, self.links, velocities, strict=True)]
        forces = list(_differences_to_next(pull))
        coupling, moments = self._coupling(), self._moments()
        for i in range(self.joints):
            for j in range(self.joints):
                if i != j:
                    turn = numerics.sin(angles[i] - angles[j])
                    forces[i] = forces[i] - coupling[i][j] * turn * rates[j] ** 2
            if self.gravity is not None:
                forces[i] = forces[i] - self.gravity * moments[i] * numerics.sin(angles[i])
        return _differences_to_last(numerics.solve_definite(self._inertia(angles), forces))

    def kick(self, positions: Vector, impulses: Vector) -> Vector:
        """Return M⁻¹ p."""
        matrix = self._inertia(_sums(positions))
        return _differences_to_last(numerics.solve_definite(matrix, _differences_to_next(impulses)))

    def tip_impulse(self, positions: Vector, impulse: Scalar) -> Vector:
        """Return the joint impulses of an impulse at the tip, across the last link [N·s] -> [N·m·s]."""
        angles = _sums(positions)
        reach = [link.length * numerics.cos(angles[-1] - a) for link, a in zip(self.links, angles, strict=True)]
        arms = tuple(sum(reach[i + 1 :], reach[i]) for i in range(self.joints))
        return tuple(arm * impulse for arm in arms)

    def energy(self, positions: Vector, velocities: Vector) -> Scalar:
        """Return ½ q̇ᵀ M q̇ + Σ g wᵢ (1 − cos φᵢ)."""
        angles, rates = _sums(positions), _sums(velocities)
        matrix, moments = self._inertia(angles), self._moments()
        total = jnp.zeros_like(angles[0])
        for i in range(self.joints):
            for j in range(self.joints):
                total = total + 0.5 * matrix[i][j] * rates[i] * rates[j]
            if self.gravity is not None:
                total = total + self.gravity * moments[i] * (1.0 - numerics.cos(angles[i]))
        return total

    def _moments(self) -> Vector:
        """Return wⱼ [kg·m]."""
        masses = [link.mass for link in self.links]
        beyond = [sum(masses[j + 1 :], jnp.zeros_like(masses[j])) for j in range(self.joints)]
        return tuple(k.mass * k.centre + k.length * m for k, m in zip(self.links, beyond, strict=True))

    def _coupling(self) -> list[list[Scalar]]:
        """Return Aᵢⱼ for i ≠ j [kg·m²]; its diagonal is not used."""
        moments, size = self._moments(), self.joints
        return [[self.links[min(i, j)].length * moments[max(i, j)] for j in range(size)] for i in range(size)]

    def _inertia(self, angles: Vector) -> list[list[Scalar]]:
        """Return the inertia matrix over absolute angles [kg·m²]."""
        coupling, masses = self._coupling(), [link.mass for link in self.links]
        matrix = [
            [
                coupling[i][j] * numerics.cos(angles[i] - angles[j]) if i != j else coupling[i][j]
                for j in range(i + 1)
            ]
            for i in range(self.joints)
        ]
        for i, link in enumerate(self.links):
            beyond = sum(masses[i + 1 :], jnp.zeros_like(link.mass))
            matrix[i][i] = link.inertia + link.mass * link.centre**2 + link.length**2 * beyond
        return [[matrix[max(i, j)][min(i, j)] for j in range(self.joints)] for i in range(self.joints)]


def _sums(values: Vector) -> Vector:
    total, found = values[0], [values[0]]
    for value in values[1:]:
        total = total + value
        found.append(total)
    return tuple(found)


def _differences_to_last(values: Vector) -> Vector:
    """Return absolute rates as joint rates."""
    return (values[0], *(own - last for last, own in pairwise(values)))


def _differences_to_next(values: Vector | list[Scalar]) -> Vector:
    """Return joint torques as torques on absolute angles."""
    return (*(own - following for own, following in pairwise(values)), values[-1])
