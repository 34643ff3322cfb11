"""One control cycle of a variable-stiffness arm: both stages of the design, and the controller with them."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from vsajax.arms import Pose, SerialArm, scaled_rows, task_scale
from vsajax.compliance.designer import StiffnessDesign, StiffnessDesigner
from vsajax.compliance.impedance import design_damping, impedance_torque, posture_damping
from vsajax.compliance.passive import StiffnessBounds
from vsajax.types import Scalar, as_leaf

_RIDGE = 1e-14
"""Of J Jᵀ: the torque stays finite at a singular pose, elsewhere it changes by 10⁻¹⁴ condition numbers."""

Joints = Float[Array, " joints"]
Matrix = Float[Array, "m m"]


class ArmReading(NamedTuple):
    """What the controller of an arm is given in one cycle.

    Args:
        position: of the joints, as the motors tell it; under gravity less the springs' deflection [rad].
        velocity: of the same [rad/s].
        posture: where the arm rests; the hand's equilibrium is the hand there [rad].
        stiffness: K_d, desired of the hand, symmetric [N/m]; for a pose the last three rows and columns are
            rotations, in N/rad and N·m/rad.
    """

    position: Joints
    velocity: Joints
    posture: Joints
    stiffness: Matrix

    @property
    def readings(self) -> tuple[Joints, Joints, Joints]:
        """What must be sound: the desired stiffness is judged by the design, which answers with a status."""
        return self.position, self.velocity, self.posture


class ArmCommand(NamedTuple):
    """What the controller of an arm answers.

    Args:
        joint_stiffness: to set the joints' mechanisms to [N·m/rad].
        torque: of the motors, without gravity's [N·m].
        active_stiffness: K_a, the gain behind that torque, in the units of the desired one [N/m].
        scale: factor on the passive compliances that leaves room for the controller.
        is_exact: whether the hand has the desired stiffness.
        status: 0 solved, 1 singular pose, 2 stiffer than the controller may be, 3 not optimal; of what is refused
            every number is NaN: 4 not finite, 5 bounds out of order, 6 not symmetric positive definite.
        held: whether a reading was broken and the last command is given again, see `vsajax.guard`; `None` of a
            bare step, which leaves no sample out.
        skipped: how many samples were left out so far.
    """

    joint_stiffness: Joints
    torque: Joints
    active_stiffness: Matrix
    scale: Scalar
    is_exact: Bool[Array, ""]
    status: Int[Array, ""]
    held: Bool[Array, ""] | None = None
    skipped: Int[Array, ""] | None = None


class ArmController(eqx.Module):
    """Stiffness design and Cartesian impedance (12), anew in every cycle; it remembers nothing.

    A task of three rows is the hand's position, one of six its pose, with rotations as displacements at `length`.

    Args:
        arm: kinematics.
        bounds: of the joints' stiffness.
        designer: of both stages.
        length: l, at which a rotation counts as a displacement [m].
        posture_stiffness: k_n, of what the hand does not see [N·m/rad].
        damping_ratio: ζ, of the motors' motion.
        motor_inertia: B of a motor, on the joint's side of its gear [kg·m²].
    """

    arm: SerialArm
    bounds: StiffnessBounds
    designer: StiffnessDesigner
    length: Scalar = eqx.field(converter=as_leaf, default=0.3)
    posture_stiffness: Scalar = eqx.field(converter=as_leaf, default=20.0)
    damping_ratio: Scalar = eqx.field(converter=as_leaf, default=0.7)
    motor_inertia: Scalar = eqx.field(converter=as_leaf, default=0.5)

    def init(self, reading: ArmReading) -> tuple[()]:
        """Return the state, of which there is none."""
        return ()

    def step(self, state: tuple[()], reading: ArmReading) -> tuple[tuple[()], ArmCommand]:
        """Return the state and the command for one cycle."""
        size = reading.stiffness.shape[0]
        units = task_scale(self.length)[:size]
        design = self.design(reading)
        frames = self.arm.forward(reading.position), self.arm.forward(reading.posture)
        jacobian = self.jacobian(reading.position, size)
        active = design.active_stiffness
        damping = design_damping(jacobian, active, self.damping_ratio, self.motor_inertia)
        force = active @ (units * displacement(*frames)[:size]) + damping @ (jacobian @ reading.velocity)
        slack = posture_damping(self.damping_ratio, self.motor_inertia, self.posture_stiffness)
        posture = self.posture_stiffness * (reading.position - reading.posture) + slack * reading.velocity
        command = ArmCommand(
            design.joint_stiffness,
            impedance_torque(jacobian, force, posture, ridge=_RIDGE),
            active * units[:, None] * units,
            design.scale,
            design.is_exact,
            design.status,
        )
        return state, command

    def design(self, reading: ArmReading) -> StiffnessDesign:
        """Return the design of both stages, in the task's coordinates, see `arms.scaled_rows`."""
        size = reading.stiffness.shape[0]
        units = task_scale(self.length)[:size]
        desired = reading.stiffness / (units[:, None] * units)
        return self.designer.design(self.jacobian(reading.position, size), desired, self.bounds)

    def jacobian(self, positions: Joints, size: int) -> Float[Array, "m joints"]:
        """Return the first rows of J, rotations scaled to displacements."""
        return scaled_rows(self.arm.jacobian(positions), self.length)[:size]


def displacement(now: Pose, rest: Pose) -> Float[Array, "6"]:
    """Return where a pose lies from another: the translation [m], and the rotation as sin(angle) · axis.

    For rotation matrices R and R₀ the latter is ½ Σ r₀ᵢ × rᵢ over their columns.
    """
    turned = 0.5 * jnp.cross(rest.rotation.T, now.rotation.T).sum(0)
    return jnp.concatenate([now.position - rest.position, turned])
