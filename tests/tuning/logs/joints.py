"""Series-elastic joints in NumPy, many at once, and what their sensors read: clean recordings of many kinds."""

from __future__ import annotations

import numpy as np

STEP, SUBSTEPS = 2e-3, 5


def recordings(
    count: int,
    *,
    samples: int = 3000,
    seed: int = 0,
    stiffness: tuple[float, float] = (8.0, 200.0),
    dry: bool = False,
) -> list[dict[str, np.ndarray]]:
    """Return clean recordings of joints of any stiffness, curvature, friction, load, encoder and noise.

    Args:
        count: of joints.
        samples: of each.
        seed: of all that is drawn.
        stiffness: between which the linear springs lie [N·m/rad].
        dry: whether every spring has dry friction inside, as a stop element.
    """
    rng = np.random.default_rng(seed)
    linear = np.exp(rng.uniform(*np.log(stiffness), count))
    cubic = linear * rng.choice([0.0, 30.0, 3000.0], count)
    inertia, damping = rng.uniform(0.02, 0.2, count), rng.uniform(0.05, 0.5, count)
    gravity = rng.choice([0.0, 0.5, 2.0], count)
    motor_inertia, motor_damping = rng.uniform(0.05, 0.2, count), rng.uniform(2.0, 8.0, count)
    friction = rng.choice([0.0, 0.2, 0.5], count)
    amplitude = rng.uniform(1.0, 4.0, count)
    frequency, phase = rng.uniform(0.2, 3.0, (3, count)), rng.uniform(0.0, 2 * np.pi, (3, count))
    slip = 0.05 * amplitude if dry else np.zeros(count)

    q, v, m, w, force, last = np.zeros((6, count))
    rows = np.empty((samples, 3, count))
    step = STEP / SUBSTEPS
    for k in range(samples):
        drive = amplitude * np.sum(np.sin(2 * np.pi * frequency * k * STEP + phase), axis=0) / 1.5
        for _ in range(SUBSTEPS):
            bend = q - m
            force = np.clip(force + linear * (bend - last), -slip, slip)
            last = bend
            torque = linear * bend + cubic * bend**3 + force
            v = v + step * (-torque - damping * v - gravity * np.sin(q)) / inertia
            w = w + step * (drive + torque - motor_damping * w - friction * np.tanh(w / 0.02)) / motor_inertia
            q, m = q + step * v, m + step * w
        bend = q - m
        rows[k] = q, m, linear * bend + cubic * bend**3 + force
    counts = rng.choice([16384.0, 65536.0, 2.0**20], count)
    noise, bias = rng.uniform(0.002, 0.02, count), rng.choice([0.0, 0.3], count)
    found = []
    for lane in range(count):
        quantum = 2 * np.pi / counts[lane]
        link, motor = (quantum * np.round(rows[:, i, lane] / quantum) for i in (0, 1))
        torque = rows[:, 2, lane] * 1.0
        torque += bias[lane] + noise[lane] * np.ptp(torque) * rng.normal(size=samples)
        time = STEP * np.arange(samples)
        found.append({"time": time, "link_position": link, "motor_position": motor, "elastic_torque": torque})
    return found
