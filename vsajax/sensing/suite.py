"""The sensors of a whole joint."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
from jaxtyping import Array, Key

from vsajax.sensing.sensors import Sensor
from vsajax.types import Recording, Series


class SensorSuite(eqx.Module):
    """One sensor a signal of `Recording`; `None` where the joint has none."""

    link_position: Sensor | None = None
    motor_position: Sensor | None = None
    setpoint_position: Sensor | None = None
    motor_torque: Sensor | None = None
    elastic_torque: Sensor | None = None
    deflection: Sensor | None = None
    motor1_position: Sensor | None = None
    motor2_position: Sensor | None = None
    motor1_torque: Sensor | None = None
    motor2_torque: Sensor | None = None

    def measure(self, time: Series, motion: Any, *, key: Key[Array, ""]) -> Recording:
        """Return what the sensors record of `motion`, a tuple with a field a signal, at `time` [s].

        A signal's noise depends on `key` and on the signal's name alone, not on which other sensors exist.
        """
        readings = {}
        for index, name in enumerate(Recording._fields[1:]):
            sensor = getattr(self, name)
            if sensor is not None:
                readings[name] = sensor(time, getattr(motion, name), key=jax.random.fold_in(key, index))
        return Recording(time, **readings)
