"""The sensors of a whole joint."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import equinox as eqx
import jax
from jaxtyping import Array, Key

from vsajax.sensing.sensors import Sensor
from vsajax.types import Recording, Series


@runtime_checkable
class Measurable(Protocol):
    """A motion whose named signals can be measured."""

    @property
    def link_position(self) -> Series: ...  # noqa: D102
    @property
    def motor_position(self) -> Series: ...  # noqa: D102
    @property
    def setpoint_position(self) -> Series: ...  # noqa: D102
    @property
    def motor_torque(self) -> Series: ...  # noqa: D102
    @property
    def elastic_torque(self) -> Series: ...  # noqa: D102
    @property
    def deflection(self) -> Series: ...  # noqa: D102


class SensorSuite(eqx.Module):
    """One sensor a signal of `Recording`; `None` where the joint has none."""

    link_position: Sensor | None = None
    motor_position: Sensor | None = None
    setpoint_position: Sensor | None = None
    motor_torque: Sensor | None = None
    elastic_torque: Sensor | None = None
    deflection: Sensor | None = None

    def measure(self, time: Series, motion: Measurable, *, key: Key[Array, ""]) -> Recording:
        """Return what the sensors record of `motion` at `time` [s].

        A signal's noise depends on `key` and on the signal's name alone, not on which other sensors exist.
        """
        readings = {}
        for index, name in enumerate(Recording._fields[1:]):
            sensor = getattr(self, name)
            if sensor is not None:
                readings[name] = sensor(time, getattr(motion, name), key=jax.random.fold_in(key, index))
        return Recording(time, **readings)
