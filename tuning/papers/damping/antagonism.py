"""The same question on an agonist-antagonist joint: what estimating both springs in the loop costs in settling.

The joint is qbmove-like: sinh springs of the exponent published for it, both with the mean of its two torque
scales, its motors as in `plants.qbmove`, and the link of the paper. Law (23) asks for 0.3 or 1 N·m/rad. What is
believed of the springs at first is wrong by a factor; a pair of estimators learns them from motor torques and
positions alone.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.ticker import FormatStrFormatter, NullFormatter

from tuning.files.whole import write_table
from tuning.papers.damping import model as paper
from tuning.papers.rows import Row
from tuning.pictures.style import ESTIMATE, OTHER, TRUTH, new_figure, save
from vsajax import SwingScorer, plants, rollout
from vsajax import estimators as es
from vsajax import sensing as se
from vsajax.experiments import antagonistic_damping

FACTORS = (0.6, 1.0, 1.6)
"""Believed over true torque of the springs at the start."""
TORQUE_STDS = (1e-3, 0.01, 0.03, 0.1, 0.2, 0.4)
"""Noise of both motor torques [N·m]; the springs hold 0.03 to 0.1 N·m at rest, and tenths as the link turns."""
IMPULSES = np.geomspace(0.01, 0.03, 9)
BAND = 0.03
_DRAWS = 4
_COLOURS = {0.6: ESTIMATE, 1.0: "#009e73", 1.6: OTHER}


def joint() -> antagonistic_damping.AntagonisticLoop:
    """Return the joint with a true belief and silent sensors."""
    published: Any = plants.qbmove()
    scale = 0.5 * (published.spring1.torque_scale + published.spring2.torque_scale)
    spring = plants.HyperbolicSpring(scale, published.spring1.exponent)
    motor = published.motor1
    side = es.StiffnessEstimator(
        torque=es.ResidualTorque(300.0, motor.inertia, motor.damping),
        basis=es.SeparableOddPolynomial(deflection_scale=0.5, deflection_terms=5),
        fit=es.RecursiveLeastSquares(prior_scale=10.0),
        gate=es.ExcitationGate(min_deflection_range=0.2, max_relative_std=3.0),
        deflection="raw",
        matched=True,
    )
    return antagonistic_damping.AntagonisticLoop(
        joint=plants.AntagonisticJoint(plants.Link(paper.INERTIA, paper.DAMPING), motor, motor, spring, spring),
        servo=antagonistic_damping.PositionServo(100.0, 0.1),
        controller=paper.CONTROLLERS["law"],
        impact=se.Impact(0.02),
        scorer=SwingScorer(BAND),
        clock=se.Clock(1e-3, 3.0),
        estimator=es.AntagonisticPair(side),
        believed1=spring,
        believed2=spring,
        soft=paper.SOFT,
        stiff=paper.STIFF,
        start=paper.SOFT,
    )


def _vary(own: antagonistic_damping.AntagonisticLoop) -> list[Any]:
    believed: Any = (own.believed1, own.believed2)
    return [own.impact.impulse, own.torque_std, own.uses_estimate, *(spring.torque_scale for spring in believed)]


@cache
def cost() -> dict[str, np.ndarray]:
    """Return the table, as `damping_estimation.cost`: means over nine impulses and four noise draws."""
    rows = [(1.0, 0.0, 0.0), *((factor, 0.0, 0.0) for factor in FACTORS if factor != 1.0)]
    rows += [(factor, std, 1.0) for factor in FACTORS for std in TORQUE_STDS]
    own = joint()
    spring: Any = own.believed1
    scale = float(spring.torque_scale)
    numbers = [
        (impulse, std, uses, scale * factor, scale * factor)
        for factor, std, uses in rows
        for impulse in IMPULSES
        for _ in range(_DRAWS)
    ]

    def one(lane: tuple[jax.Array, jax.Array], shared: antagonistic_damping.AntagonisticLoop) -> Any:
        values, key = lane
        return antagonistic_damping.score(eqx.tree_at(_vary, shared, list(values)), key=key)

    lanes = (jnp.asarray(numbers), jax.random.split(jax.random.key(0), len(numbers)))
    found = jax.jit(lambda lanes, shared: rollout.map_lanes(one, lanes, shared))(lanes, own)
    shape = (len(rows), len(IMPULSES), _DRAWS)
    settled = np.asarray(found.swing.settling_time).reshape(shape)
    scatter = settled - settled.mean(axis=2, keepdims=True)
    msrep = np.asarray(found.msrep).reshape(shape[0], -1)
    seen = np.isfinite(msrep)
    known = np.asarray(found.known_time).reshape(shape[0], -1)
    return {
        "believed_over_true": np.array([row[0] for row in rows]),
        "torque_noise_std": np.array([row[1] for row in rows]),
        "estimates": np.array([row[2] for row in rows]),
        "settling_time": settled.mean(axis=(1, 2)),
        "settling_reach": 1.96 * scatter.std(axis=(1, 2)) / np.sqrt(shape[1] * (shape[2] - 1)),
        "log_energy": np.asarray(found.swing.log_energy).reshape(shape[0], -1).mean(axis=1),
        "msrep_percent": np.array(
            [np.median(m[s]) if s.any() else np.nan for m, s in zip(msrep, seen, strict=True)]
        ),
        "known_time": np.median(known, axis=1),
        "known_share": np.isfinite(known).mean(axis=1),
    }


def rows() -> list[Row]:
    """Return what a wrong belief costs on this joint, and what the estimate gives back."""
    table = cost()

    def at(factor: float, std: float, estimates: float) -> tuple[float, float]:
        is_it = (table["believed_over_true"] == factor) & (table["estimates"] == estimates)
        is_it &= table["torque_noise_std"] == std
        return float(table["settling_time"][is_it][0]), float(table["settling_reach"][is_it][0])

    known, _ = at(1.0, 0.0, 0.0)
    wrong, _ = at(1.6, 0.0, 0.0)
    estimated, reach = at(1.6, 1e-3, 1.0)
    note = "antagonistic joint; ratio of mean settling times"
    return [
        Row("springs believed 1.6 times too strong, over known springs", None, wrong / known, "1", 1.0, 1.5, note),
        Row(
            "the same, estimated with torque noise 1e-3 N·m, over not estimated: upper end of 95 %",
            None,
            (estimated + reach) / wrong,
            "1",
            0.5,
            1.0,
            "below 1: the estimate gives settling back",
        ),
    ]


def draw(folder: Path) -> Path:
    """Draw settling against MSREP, and one run over time; write the table beside it."""
    table = cost()
    write_table(folder / "antagonism.csv", table)
    figure, (axis, above, below) = new_figure(10.5, 4.0, 1, 3, width_ratios=(1.2, 1, 1))
    for factor, colour in _COLOURS.items():
        mine = table["believed_over_true"] == factor
        own, wrong = mine & (table["estimates"] == 1.0), mine & (table["estimates"] == 0.0)
        axis.errorbar(
            table["msrep_percent"][own],
            table["settling_time"][own],
            table["settling_reach"][own],
            fmt="o-",
            color=colour,
            capsize=3,
            label=f"believed {factor:g}×, then estimated",
        )
        ever = "known" if factor == 1.0 else f"believed {factor:g}× for ever"
        axis.axhline(table["settling_time"][wrong][0], color=colour, linestyle="--", label=ever)
    axis.set_xscale("log")
    axis.xaxis.set_major_formatter(FormatStrFormatter("%g"))
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.set(xlabel="MSREP where known [%]", ylabel="mean settling time [s]")
    axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2, fontsize=7)
    own = eqx.tree_at(_vary, joint(), [0.02, 1e-3, 1.0, *(1.6 * s for s in _vary(joint())[3:])])
    motion = eqx.filter_jit(antagonistic_damping.simulate)(own, key=paper.KEY)
    time, early = np.asarray(motion.time), np.asarray(motion.time) <= 1.0
    above.plot(time[early], motion.stiffness[early], color=TRUTH, label="true")
    estimate = np.where(np.asarray(motion.known) > 0, np.asarray(motion.estimate), np.nan)
    above.plot(time[early], estimate[early], "--", color=OTHER, label="estimated, once known")
    above.set(xlabel="time after the impact [s]", ylabel="stiffness of the joint [N·m/rad]", ylim=(0, None))
    below.plot(time[early], motion.wanted[early], color=OTHER, label="asked for")
    below.plot(time[early], motion.given[early], color=TRUTH, label="given")
    below.set(xlabel="time after the impact [s]", ylabel="undeflected stiffness [N·m/rad]", ylim=(0, None))
    for one in (above, below):
        one.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), fontsize=8)
    figure.suptitle("An antagonistic joint that learns its springs, believed 1.6 times too strong at first")
    return save(figure, folder / "antagonism.png")
