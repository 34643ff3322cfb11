"""The lag of a torque signal, and features that lag as much.

Letters: K the lag's gain [1/s], T the time since the last sample [s], x what goes in, y what comes out.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp

from vsajax.numerics import Vector, lanes_minor, once
from vsajax.types import Scalar


class LagState(NamedTuple):
    """What came out, and what went in, at the last sample."""

    outputs: Vector
    inputs: Vector


def start_lag(values: Vector) -> LagState:
    """Return the state before the first sample: nothing has come out yet, as of a residual observer at rest."""
    return LagState(jnp.zeros_like(values), values)


def lagged(state: LagState, values: Vector, gain: Scalar, dt: Scalar) -> LagState:
    """Return the state whose outputs are values through the first-order lag K / (s + K), by the trapezoidal rule.

    y(k) = ((2 − TK) y(k−1) + TK (x(k) + x(k−1))) / (2 + TK): to rounding what the residual observer (8) of Flacco
    et al., IROS 2011, makes of an elastic torque x, on an irregular clock too. As the lag is linear, a torque that
    is a weighted sum of features lags to the same sum of lagged features.

    Args:
        state: of the last sample.
        values: x(k).
        gain: K [1/s].
        dt: T [s].
    """
    gain_step = gain * dt
    scale = 1.0 / (2.0 + gain_step)
    outputs = ((2.0 - gain_step) * state.outputs + gain_step * (values + state.inputs)) * scale
    return LagState(once(lanes_minor(outputs)), values)
