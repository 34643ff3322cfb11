"""The modified kinematic Kalman filter (9)–(11) of Flacco et al., IROS 2011, in matrices."""

import numpy as np
from scipy.special import expit


def mkkf(readings, dt, *, acceleration_variance=5e9, slow=10.0, fast=0.1, sharpness=6.0, counts=40000.0):
    """Return positions and velocities; R = `slow` = `fast` gives the filter with constant R."""
    state, covariance, answers = np.array([readings[0], 0.0]), np.diag([10.0, 1.0]), []
    for reading, step in zip(readings, dt, strict=True):
        speed = abs(state[1]) * step * counts / (2 * np.pi)
        variance = (slow - fast) * expit(-(speed - 1) * sharpness) + fast
        transition, drive = np.array([[1, step], [0, 1]]), np.array([step**2 / 2, step])
        state = transition @ state
        covariance = transition @ covariance @ transition.T + acceleration_variance * np.outer(drive, drive)
        gain = covariance[:, 0] / (covariance[0, 0] + variance)
        state = state + gain * (reading - state[0])
        covariance = covariance - np.outer(gain, covariance[0])
        answers.append(state)
    return np.array(answers).T
