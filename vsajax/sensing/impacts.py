"""What sets a joint swinging: impulses and pulses."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from vsajax.types import Scalar, as_leaf


class Pulse(eqx.Module):
    """A constant torque from the start on.

    Args:
        torque: [N·m].
        duration: [s].
    """

    torque: Scalar = eqx.field(converter=as_leaf)
    duration: Scalar = eqx.field(converter=as_leaf)

    def mean(self, time: Scalar, step: Scalar) -> Scalar:
        """Return the mean torque over a step that begins at `time` [s]."""
        return self.torque * jnp.clip((self.duration - time) / step, 0.0, 1.0)


class Impact(eqx.Module):
    """A blow at time 0 on the joints, all alike unless `shares` say otherwise.

    Args:
        impulse: [N·m·s].
        pulse: a torque that lasts, or `None`.
        shares: factor of both on each joint; `None` is 1 on every joint.
    """

    impulse: Scalar = eqx.field(converter=as_leaf, default=0.0)
    pulse: Pulse | None = None
    shares: tuple[Scalar, ...] | None = eqx.field(
        converter=lambda shares: None if shares is None else tuple(map(as_leaf, shares)), default=None
    )

    def impulses(self, joints: int) -> tuple[Scalar, ...]:
        """Return the joint impulses [N·m·s]."""
        return tuple(self.impulse * share for share in self._shares(joints))

    def torques(self, joints: int, time: Scalar, step: Scalar) -> tuple[Scalar, ...]:
        """Return the mean joint torques over a step that begins at `time` [s], in N·m."""
        torque = jnp.zeros_like(self.impulse) if self.pulse is None else self.pulse.mean(time, step)
        return tuple(torque * share for share in self._shares(joints))

    def _shares(self, joints: int) -> tuple[Scalar, ...]:
        if self.shares is None:
            return (as_leaf(1.0),) * joints
        if len(self.shares) != joints:
            raise ValueError(f"an impact needs one share a joint; got {len(self.shares)} for {joints} joints")
        return self.shares
