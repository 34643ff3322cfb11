"""What it costs a damping controller to estimate the stiffness that it commands: settling against MSREP.

The spring is σ = 0.2 + γ N·m/rad, the controller law (23) between 0.3 and 1 N·m/rad, the actuator takes 30 ms.
What is believed of the spring at first is wrong by a factor; an estimator learns it from a torque sensor, in the
loop.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from tuning.files.whole import write_table
from tuning.papers.damping import model as paper
from tuning.papers.rows import Row
from tuning.pictures.style import ESTIMATE, OTHER, QUIET, TRUTH, new_figure, save
from vsajax import estimators as es
from vsajax import plants, rollout
from vsajax.experiments import estimated_damping

_BASE, _GAIN = 0.2, 1.0
FACTORS = (0.6, 1.6)
"""Believed over true stiffness at the start."""
TORQUE_STDS = (1e-3, 3e-3, 0.01, 0.03, 0.06, 0.1, 0.15, 0.2)
"""Noise of the torque sensor [N·m]; the spring's torque peaks near 1 N·m and falls with the swing."""
_DRAWS = 4
_COLOURS = {0.6: ESTIMATE, 1.6: OTHER}


def joint() -> estimated_damping.EstimatedLoop:
    """Return the joint with a true belief and a silent sensor."""
    law = estimated_damping.PresetLaw(_BASE, _GAIN)
    loop = paper.link_loop(paper.CONTROLLERS["law"], travel=0.03, sample_time=1e-3)
    plant = eqx.tree_at(lambda p: p.actuator, loop.plant, plants.StiffnessActuator(_BASE, _BASE + _GAIN, 0.03))
    estimator = es.StiffnessEstimator(
        torque=es.SensorTorque(),
        basis=es.SeparableOddPolynomial(setpoint_terms=2),
        fit=es.RecursiveLeastSquares(prior_scale=100.0),
        gate=es.ExcitationGate(min_deflection_range=0.05, max_relative_std=0.05),
        deflection="raw",
    )
    return estimated_damping.EstimatedLoop(
        eqx.tree_at(lambda own: own.plant, loop, plant), law, law, estimator, 0.0
    )


def _vary(own: estimated_damping.EstimatedLoop) -> list[Any]:
    return [own.loop.impact.impulse, own.torque_std, own.nominal.base, own.nominal.gain, own.uses_estimate]


@cache
def _compiled() -> Any:
    def one(lane: tuple[jax.Array, jax.Array], shared: estimated_damping.EstimatedLoop) -> Any:
        numbers, key = lane
        return estimated_damping.score(eqx.tree_at(_vary, shared, list(numbers)), key=key)

    return jax.jit(lambda lanes, shared: rollout.map_lanes(one, lanes, shared))


@cache
def cost() -> dict[str, np.ndarray]:
    """Return the table: believed over true stiffness, noise, whether estimated, and what came of it.

    Means over 21 impulses and four noise draws; the interval is 1.96 standard errors over the draws' differences
    from the mean of their impulse.
    """
    rows = [(1.0, 0.0, 0.0), *((factor, 0.0, 0.0) for factor in FACTORS)]
    rows += [(factor, std, 1.0) for factor in FACTORS for std in TORQUE_STDS]
    numbers = [
        (impulse, std, _BASE * factor, _GAIN * factor, uses)
        for factor, std, uses in rows
        for impulse in paper.IMPULSES
        for _ in range(_DRAWS)
    ]
    keys = jax.random.split(jax.random.key(0), len(numbers))
    found = _compiled()((jnp.asarray(numbers), keys), joint())
    shape = (len(rows), len(paper.IMPULSES), _DRAWS)
    settled = np.asarray(found.swing.settling_time).reshape(shape)
    scatter = settled - settled.mean(axis=2, keepdims=True)
    known = np.isfinite(np.asarray(found.known_time)).reshape(shape)
    return {
        "believed_over_true": np.array([row[0] for row in rows]),
        "torque_noise_std": np.array([row[1] for row in rows]),
        "estimates": np.array([row[2] for row in rows]),
        "settling_time": settled.mean(axis=(1, 2)),
        "settling_reach": 1.96 * scatter.std(axis=(1, 2)) / np.sqrt(shape[1] * (shape[2] - 1)),
        "msrep_percent": np.array(
            [np.nanmean(m) if np.isfinite(m).any() else np.nan for m in _by_row(found.msrep, shape)]
        ),
        "known_share": known.mean(axis=(1, 2)),
    }


def _by_row(values: Any, shape: tuple[int, ...]) -> list[np.ndarray]:
    return list(np.asarray(values).reshape(shape[0], -1))


def rows() -> list[Row]:
    """Return what the estimate gives back, and what it costs."""
    table = cost()
    known = table["settling_time"][0]

    def over(factor: float, std: float, estimates: float) -> float:
        is_it = (table["believed_over_true"] == factor) & (table["estimates"] == estimates)
        return float(table["settling_time"][is_it & (table["torque_noise_std"] == std)][0] / known)

    note = "mean settling time over that with a known spring"
    return [
        Row(
            "stiffness believed 1.6 times too large, not estimated", None, over(1.6, 0.0, 0.0), "1", 1.2, 1.4, note
        ),
        Row(
            "the same, estimated from torque with noise 0.03 N·m",
            None,
            over(1.6, 0.03, 1.0),
            "1",
            0.95,
            1.05,
            note,
        ),
    ]


def draw(folder: Path) -> Path:
    """Draw settling against MSREP, and write the table beside it."""
    table = cost()
    write_table(folder / "estimation.csv", table)
    figure, axis = new_figure(7.0, 4.0)
    for factor, colour in _COLOURS.items():
        own = (table["believed_over_true"] == factor) & (table["estimates"] == 1.0)
        axis.errorbar(
            table["msrep_percent"][own],
            table["settling_time"][own],
            table["settling_reach"][own],
            fmt="o-",
            color=colour,
            capsize=3,
            label=f"believed {factor:g} times the truth, then estimated",
        )
        wrong = table["settling_time"][(table["believed_over_true"] == factor) & (table["estimates"] == 0.0)][0]
        axis.axhline(wrong, color=colour, linestyle="--", label=f"believed {factor:g} times the truth for ever")
    axis.axhline(table["settling_time"][0], color=TRUTH, label="known")
    axis.axvline(1.0, color=QUIET, linewidth=0.8)
    axis.set_xscale("log")
    axis.set(xlabel="MSREP of the estimate since it was known [%]", ylabel="mean settling time [s]")
    axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)
    figure.suptitle("What estimating the stiffness costs")
    return save(figure, folder / "estimation.png")
