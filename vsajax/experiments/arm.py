"""The arm under its impedance controller: where a force moves it, and how stiff the hand then is."""

from __future__ import annotations

from typing import Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from vsajax import numerics, rollout
from vsajax.compliance import hand_compliance
from vsajax.compliance.impedance import CartesianImpedance
from vsajax.plants.compliant_arm import ArmMotion, CompliantArm
from vsajax.solvers import inverse
from vsajax.types import Scalar

Joints = Float[Array, " joints"]
Both = Float[Array, " both"]
Force = Float[Array, "3"]
Matrix = Float[Array, "3 3"]

View = Literal["motor", "shifted", "quasi_static"]
"""Which joint positions v the controller sees, and with them gravity.

"motor": θ, and the gravity torque at the posture as a constant. "shifted": θ less the deflection under gravity at
the posture, and gravity there. "quasi_static": the links' positions that gravity alone would give with motors at
θ, g(v) = τ_e(θ − v), and gravity at the links themselves; it keeps the stiffness of the hand best.
"""

_VIEW_STEPS = 6
_BALANCED = 1e-6


class ArmLoop(eqx.Module):
    """A compliant arm and its controller.

    Args:
        plant: the arm.
        controller: with the posture at which the links rest.
        view: see `View`.
    """

    plant: CompliantArm
    controller: CartesianImpedance
    view: View = eqx.field(static=True, default="quasi_static")

    @classmethod
    def at(
        cls, plant: CompliantArm, controller: CartesianImpedance, posture: Joints, *, view: View = "quasi_static"
    ) -> ArmLoop:
        """Return the loop whose links rest at `posture` without a force; the controller's own posture follows."""
        loop = cls(plant, controller, view)
        own = loop.rest(posture).motor_position if view == "motor" else posture
        return eqx.tree_at(lambda whole: whole.controller.posture, loop, own)

    def rest(self, posture: Joints) -> ArmMotion:
        """Return the arm at rest with its links at `posture`, held against gravity."""
        load = self.plant.bodies.load(self.plant.arm, posture)
        still = jnp.zeros_like(posture)

        # τ_e is monotonic: Newton from a linear guess, on the deflection.
        def improve(deflection: Joints) -> Joints:
            rate = self.plant.stiffness(-deflection, still)
            return deflection + (load - self.plant.elastic_torque(-deflection, still)) / rate

        deflection = rollout.repeat(improve, still, times=40)
        return ArmMotion(posture, posture + deflection, still, still)

    def command(self, motion: ArmMotion, at_rest: ArmMotion) -> Joints:
        """Return the motor torques u for a motion; `at_rest` is the arm without a force."""
        link, motor, _, motor_velocity = motion
        bodies, arm = self.plant.bodies, self.plant.arm
        if self.view == "motor":
            return bodies.load(arm, at_rest.link_position) + self.controller.torque(motor, motor_velocity)
        if self.view == "shifted":
            seen = motor - (at_rest.motor_position - at_rest.link_position)
            return bodies.load(arm, seen) + self.controller.torque(seen, motor_velocity)
        seen = motor - (at_rest.motor_position - at_rest.link_position)

        def improve(seen: Joints) -> Joints:
            slope = jnp.diag(self.plant.stiffness(seen, motor)) + bodies.load_stiffness(arm, seen)
            error = self.plant.elastic_torque(seen, motor) - bodies.load(arm, seen)
            return seen + numerics.solve_square(slope, error[:, None])[:, 0]

        seen = rollout.repeat(improve, seen, times=_VIEW_STEPS)
        return bodies.load(arm, link) + self.controller.torque(seen, motor_velocity)

    def unbalanced(self, positions: Joints, force: Force, at_rest: ArmMotion) -> Joints:
        """Return the torques on links, then motors, at rest at `positions` (links, then motors)."""
        link, motor = jnp.split(positions, 2)
        still = jnp.zeros_like(link)
        command = self.command(ArmMotion(link, motor, still, still), at_rest)
        on_motor = command - self.plant.elastic_torque(link, motor)
        return jnp.concatenate([self.plant.unbalanced(link, motor, force), on_motor])


class Equilibrium(NamedTuple):
    """Where a force holds the arm.

    Args:
        link_position: q [rad].
        motor_position: θ [rad].
        residual: the largest torque that was not balanced before the last Newton step [N·m]; above 1e-6 no
            equilibrium was found, and every other number is NaN.
        hand: displacement of the hand from rest [m].
        motor_hand: displacement of the hand that the motors' motion alone would make [m].
        joint_stiffness: the springs' present stiffness [N·m/rad].
        stiffness: dF/dx of the closed loop, the effective stiffness of the hand [N/m].
        predicted: (C_a + J diag(1/k) Jᵀ)⁻¹ at q, what (6) says of it [N/m].
    """

    link_position: Joints
    motor_position: Joints
    residual: Scalar
    hand: Force
    motor_hand: Force
    joint_stiffness: Joints
    stiffness: Matrix
    predicted: Matrix


def equilibria(
    loop: ArmLoop, posture: Joints, forces: Float[Array, "steps 3"], *, iterations: int = 12
) -> Equilibrium:
    """Return where a sequence of forces, each near the one before, holds the arm; a leading axis a field.

    Args:
        loop: from `ArmLoop.at` with the same posture.
        posture: links' positions without a force [rad].
        forces: at the hand [N].
        iterations: Newton steps a force; the stiffness is that of the last one.
    """
    at_rest = loop.rest(posture)
    start = jnp.concatenate([at_rest.link_position, at_rest.motor_position])

    def hold(positions: Both, force: Force) -> tuple[Both, Equilibrium]:
        def unbalanced(positions: Both) -> tuple[Both, Both]:
            error = loop.unbalanced(positions, force, at_rest)
            return error, error

        def improve(now: _Newton) -> _Newton:
            slope, error = jax.jacfwd(unbalanced, has_aux=True)(now.positions)
            jacobian = loop.plant.arm.position_jacobian(now.positions[: posture.shape[0]])
            # A force enters by the links' Jᵀ F alone, and moves the arm by the same slope that Newton divides by.
            pull = jnp.concatenate([jacobian.T, jnp.zeros_like(jacobian.T)])
            solved = numerics.solve_square(slope, jnp.concatenate([error[:, None], -pull], axis=1))
            return _Newton(now.positions - solved[:, 0], solved[: posture.shape[0], 1:], jnp.abs(error).max())

        first = _Newton(positions, jnp.zeros((posture.shape[0], 3)), jnp.asarray(jnp.inf))
        last = rollout.repeat(improve, first, times=iterations)
        return last.positions, _describe(loop, last, at_rest)

    return rollout.scan(hold, start, forces)[1]


class _Newton(NamedTuple):
    """Positions of links and motors, and of the iterate before them ∂q/∂F and the largest torque unbalanced."""

    positions: Both
    moved: Float[Array, "joints 3"]
    residual: Scalar


def _describe(loop: ArmLoop, found: _Newton, at_rest: ArmMotion) -> Equilibrium:
    link, motor = jnp.split(found.positions, 2)
    plant, arm = loop.plant, loop.plant.arm
    jacobian = arm.position_jacobian(link)
    joint_stiffness = plant.stiffness(link, motor)
    shift = 0.0 if loop.view == "motor" else at_rest.motor_position - at_rest.link_position
    passive = hand_compliance(jacobian, 1.0 / joint_stiffness)
    hands = jax.vmap(lambda q: arm.forward(q).position)(
        jnp.stack([link, at_rest.link_position, motor - shift, at_rest.motor_position - shift])
    )
    # Where Newton did not arrive, nothing is an equilibrium.
    kept = jnp.where(found.residual < _BALANCED, 1.0, jnp.nan)
    return Equilibrium(
        link * kept,
        motor * kept,
        found.residual,
        (hands[0] - hands[1]) * kept,
        (hands[2] - hands[3]) * kept,
        joint_stiffness * kept,
        numerics.solve_square(jacobian @ found.moved, jnp.eye(3)) * kept,
        inverse(inverse(loop.controller.stiffness) + passive) * kept,
    )


def simulate(
    loop: ArmLoop, posture: Joints, forces: Float[Array, "time 3"], step: Scalar | float
) -> tuple[ArmMotion, Float[Array, "time 3"]]:
    """Return the motion of the arm and its hand's displacement [m] under forces held over each step.

    Classical Runge–Kutta: choose the step well below the reciprocal of the stiffest mode's rate.

    Args:
        loop: from `ArmLoop.at` with the same posture.
        posture: links' positions at the start, at rest [rad].
        forces: at the hand, one a step [N].
        step: [s].
    """
    at_rest = loop.rest(posture)
    rest_hand = loop.plant.arm.forward(posture).position

    def rates(motion: ArmMotion, force: Force) -> ArmMotion:
        return loop.plant.rates(motion, loop.command(motion, at_rest), force)

    def advance(motion: ArmMotion, force: Force) -> tuple[ArmMotion, tuple[ArmMotion, Force]]:
        first = rates(motion, force)
        second = rates(motion.moved(first, 0.5 * step), force)
        third = rates(motion.moved(second, 0.5 * step), force)
        fourth = rates(motion.moved(third, step), force)
        stages = zip(first, second, third, fourth, strict=True)
        mean = ArmMotion(*((a + 2.0 * (b + c) + d) / 6.0 for a, b, c, d in stages))
        following = motion.moved(mean, step)
        hand = loop.plant.arm.forward(following.link_position).position - rest_hand
        return following, (following, hand)

    return rollout.scan(advance, at_rest, forces)[1]
