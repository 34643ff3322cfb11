"""The residual (6)–(8) of Flacco et al., IROS 2011, by the printed formulas."""

import numpy as np


def elastic_torque(torque, position, velocity, dt, *, gain, inertia, damping, gear_ratio):
    """Return γ r_e; `dt` is the time since the last sample, 0 for the first."""
    impulse = np.cumsum(0.5 * (torque + np.concatenate([torque[:1], torque[:-1]])) * dt)
    raw = gain * (inertia * gear_ratio * velocity + damping * gear_ratio * position - impulse)
    residual = np.zeros_like(raw)
    for k in range(1, len(raw)):
        step = gain * dt[k]
        residual[k] = ((2 - step) * residual[k - 1] + 2 * (raw[k] - raw[k - 1])) / (2 + step)
    return gear_ratio * residual
