"""The paper's joint, controllers and costs, as the rows and the figures use them."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from vsajax import ControlLoop, SwingMotion, SwingScorer, SwingScores, control, plants, rollout, switching
from vsajax import sensing as se
from vsajax.experiments import damping as closed_loop

INERTIA, DAMPING, SOFT, STIFF, BAND, IMPULSE = 0.00326, 0.01, 0.3, 1.0, 0.05, 0.069
"""Reading R1 of section VI-A: I_rot + m d² [kg·m²], linear friction, stiffness range, band, 1 N·m × 69 ms."""
IMPULSES = np.geomspace(0.0345, 0.138, 21)
"""Last-exit settling is a staircase in the impulse: means are taken over these [N·m·s]."""
TRAVEL = 0.1
"""The qbmove's travel time from end to end [s]."""
RATE = float(np.sqrt(0.5 * (SOFT + STIFF) / INERTIA))
ARM_BAND = float(np.deg2rad(2.0))
KEY = jax.random.key(0)
CONTROLLERS: dict[str, control.AbstractController] = {
    "soft": control.ConstantStiffness(SOFT),
    "stiff": control.ConstantStiffness(STIFF),
    "law": control.StiffnessSwitch(SOFT, STIFF),
}
_RANGES = {"soft": (SOFT, SOFT), "stiff": (STIFF, STIFF), "law": (SOFT, STIFF)}


def oscillator(damping: float = DAMPING) -> switching.Oscillator:
    """Return the link in closed form."""
    return switching.Oscillator(jnp.asarray(INERTIA), jnp.asarray(damping))


def exact(name: str, **blow: Any) -> switching.Exact:
    """Return the event-accurate motion at a constant stiffness or under law (23)."""
    return switching.exact_motion(oscillator(), *map(jnp.asarray, _RANGES[name]), **blow)


def link_loop(
    controller: control.AbstractController,
    *,
    inertia: float = INERTIA,
    damping: float = DAMPING,
    impulse: float = IMPULSE,
    travel: float | None = None,
    sample_time: float = 5e-4,
    duration: float = 4.0,
    actuator: tuple[float, float] = (SOFT, STIFF),
    **options: Any,
) -> ControlLoop:
    """Return the single link in a loop; an actuator that takes its time stands soft when the impact comes."""
    plant = plants.SwitchedPlant(
        plants.SingleLink(plants.Link(inertia, damping)),
        plants.StiffnessActuator(*actuator, travel),
        options.pop("motor", None),
    )
    start = None if travel is None else SOFT
    clock = se.Clock(sample_time, duration)
    return ControlLoop(plant, se.Impact(impulse), controller, SwingScorer(BAND), clock, start=start, **options)


def arm_loop(controller: control.AbstractController, *, duration: float = 8.0) -> ControlLoop:
    """Return the arm of two modules of 0.26 kg, hit across at its tip with 0.10 N·s.

    The paper gives no inertias for it: these are our choice, with friction 0.01 N·m·s/rad.
    """
    link = plants.ArmLink(0.26, 0.1, 0.1, 0.26 * 0.066**2 / 6.0, DAMPING)
    arm = plants.PlanarArm((link, link))
    impulses = arm.tip_impulse((jnp.zeros(()),) * 2, jnp.asarray(0.1))
    plant = plants.SwitchedPlant(arm, plants.StiffnessActuator(SOFT, STIFF))
    impact, clock = se.Impact(1.0, shares=impulses), se.Clock(2e-4, duration)
    return ControlLoop(plant, impact, controller, SwingScorer(ARM_BAND), clock)


@eqx.filter_jit
def motion_of(loop: ControlLoop) -> SwingMotion:
    """Return a loop's motion, one integration step a sample."""
    return closed_loop.simulate(loop, key=KEY, substeps=1)


def scores_over(loop: ControlLoop, vary: Callable[[ControlLoop], list[Any]], values: np.ndarray) -> SwingScores:
    """Return `(lane,)` scores of a loop with some of its numbers replaced by `(lane, number)` values."""
    return _scores_over(loop, vary, jnp.asarray(values))


@eqx.filter_jit
def _scores_over(loop: ControlLoop, vary: Callable[[ControlLoop], list[Any]], values: jax.Array) -> SwingScores:
    def one(own: jax.Array, shared: ControlLoop) -> SwingScores:
        return closed_loop.score(eqx.tree_at(vary, shared, list(own)), key=KEY, substeps=1)

    return rollout.map_lanes(one, values, loop)


def blow_of(loop: ControlLoop) -> list[Any]:
    """Return the impulse and the inertia of a single link's loop."""
    mechanism: Any = loop.plant.mechanism
    return [loop.impact.impulse, mechanism.link.inertia]


def mean_settling(loop: ControlLoop, inertias: Sequence[float] = (INERTIA,)) -> np.ndarray:
    """Return the mean settling time over the impulses at each inertia [s]."""
    lanes = np.array(list(itertools.product(IMPULSES, inertias)))
    each = np.asarray(scores_over(loop, blow_of, lanes).settling_time)
    return each.reshape(len(IMPULSES), len(inertias)).mean(axis=0)


def conic_loop(travel: float | None = TRAVEL, **options: Any) -> ControlLoop:
    """Return the loop with a conic rule, at law (23) itself."""
    return link_loop(control.StiffnessSwitch(SOFT, STIFF, control.Conic()), travel=travel, **options)


def _conic(loop: ControlLoop) -> list[Any]:
    controller: Any = loop.controller
    return [controller.rule.lead, controller.rule.slope]


@cache
def tuned_conic() -> tuple[tuple[float, float], np.ndarray, np.ndarray, np.ndarray]:
    """Return the best (a, c) at the slow actuator, and the grid that it is the best of: a, c, mean log-energy.

    The log-energy is averaged over 40 other impulses at the inertia I; settling times are not looked at.
    """
    leads, slopes = np.linspace(0.0, 0.1, 21), np.linspace(0.0, 20.0, 21)
    lanes = np.array(
        [(blow, INERTIA, a, c) for a in leads for c in slopes for blow in np.geomspace(0.03, 0.15, 40)]
    )
    loop = conic_loop(sample_time=1e-3)
    found = scores_over(loop, lambda one: [*blow_of(one), *_conic(one)], lanes)
    energy = np.asarray(found.log_energy).reshape(len(leads), len(slopes), -1).mean(axis=2)
    best = np.unravel_index(np.argmin(energy), energy.shape)
    return (float(leads[best[0]]), float(slopes[best[1]])), leads, slopes, energy


def simulated_rate(share: float, soft: float, stiff: float) -> float:
    """Return the energy's decay rate without friction, from the speeds at the centre of a simulation [1/s]."""
    rule = control.DelayedRelease(share)
    controller = control.StiffnessSwitch(soft, stiff, rule)
    duration = 12.0 * 0.5 * np.pi * np.sqrt(INERTIA) * (soft**-0.5 + stiff**-0.5)
    step = 2e-5
    loop = link_loop(
        controller,
        damping=0.0,
        sample_time=step,
        duration=round(duration / step) * step,
        actuator=(soft, stiff),
    )
    motion = motion_of(loop)
    q, v, time = (np.asarray(x) for x in (motion.positions[0], motion.velocities[0], motion.time))
    before = np.flatnonzero(q[1:-1] * q[2:] < 0.0) + 1
    share_of_step = q[before] / (q[before] - q[before + 1])
    speed = np.abs(v[before] + share_of_step * (v[before + 1] - v[before]))
    crossing = time[before] + share_of_step * step
    return float(-2.0 * np.log(speed[-1] / speed[0]) / (crossing[-1] - crossing[0]))


def optimal_costs() -> dict[str, switching.EndCost]:
    """Return the costs that are compared."""
    inertia = jnp.asarray(INERTIA)
    return {
        "φ of the paper": switching.EndCost.printed(),
        "energy at k_min": switching.EndCost.energy(jnp.asarray(SOFT), inertia),
        "energy at k_max": switching.EndCost.energy(jnp.asarray(STIFF), inertia),
    }


@eqx.filter_jit
def best_end(time: jax.Array, cost: switching.EndCost) -> switching.Optimum:
    """Return the optimum from (0, 1) without friction."""
    soft, stiff = (jnp.sqrt(k / jnp.asarray(INERTIA)) for k in (SOFT, STIFF))
    start = switching.Phase(jnp.zeros(()), jnp.ones(()))
    return switching.optimum(start, time, cost, soft, stiff)


def law_cost(time: jax.Array, cost: switching.EndCost) -> jax.Array:
    """Return what law (23) makes of the same start."""
    free = oscillator(0.0)
    motion = switching.exact_motion(free, jnp.asarray(SOFT), jnp.asarray(STIFF), impulse=INERTIA)
    return cost.of(motion.at(free, time)[0])


def law_over_optimum(times: np.ndarray, cost: switching.EndCost) -> np.ndarray:
    """Return what law (23) costs over the optimum at each end time [s]."""
    best = np.array([float(best_end(jnp.asarray(time), cost).cost) for time in times])
    return np.array([float(law_cost(jnp.asarray(time), cost)) for time in times]) / best


def arm_settling(motion: SwingMotion) -> list[float]:
    """Return each joint's last exit from the band [s]."""
    outside = [np.flatnonzero(np.abs(np.asarray(q)) > ARM_BAND)[-1] for q in motion.positions]
    return [float(motion.time[i]) for i in outside]
