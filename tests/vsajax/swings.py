"""The plants of Gasparri et al. as the theory page reads them: one link (R1) and a planar arm of two."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from vsajax import ControlLoop, SwingScorer, plants, sensing
from vsajax.control import AbstractController, ConstantStiffness, StiffnessSwitch

INERTIA, DAMPING, SOFT, STIFF, IMPULSE = 0.00326, 0.01, 0.3, 1.0, 0.069
RATE = (0.5 * (SOFT + STIFF) / INERTIA) ** 0.5
CONTROLLERS = {
    "soft": ConstantStiffness(SOFT),
    "stiff": ConstantStiffness(STIFF),
    "law": StiffnessSwitch(SOFT, STIFF),
}
KEY = jax.random.key(0)


def link_plant(inertia: float = INERTIA, damping: float = DAMPING, travel_time: float | None = None, **link: Any):
    """Return the single link."""
    mechanism = plants.SingleLink(plants.Link(inertia, damping, **link))
    return plants.SwitchedPlant(mechanism, plants.StiffnessActuator(SOFT, STIFF, travel_time))


def arm_plant(damping: float = 0.01) -> plants.SwitchedPlant:
    """Return the arm: two modules of 0.26 kg, each at 0.1 m from its joint."""
    link = plants.ArmLink(0.26, 0.1, 0.1, 0.26 * 0.066**2 / 6.0, damping)
    return plants.SwitchedPlant(plants.PlanarArm((link, link)), plants.StiffnessActuator(SOFT, STIFF))


def arm_impact(plant: plants.SwitchedPlant, impulse: float = 0.1) -> sensing.Impact:
    """Return a lateral impulse at the arm's tip [N·s], the arm straight."""
    mechanism = plant.mechanism
    assert isinstance(mechanism, plants.PlanarArm)
    straight = (jnp.zeros(()),) * mechanism.joints
    return sensing.Impact(1.0, shares=mechanism.tip_impulse(straight, jnp.asarray(impulse)))


def loop(
    controller: AbstractController,
    plant: plants.SwitchedPlant | None = None,
    impact: sensing.Impact | None = None,
    *,
    sample_time: float = 1e-3,
    duration: float = 2.5,
    band: float = 0.05,
    **options: Any,
) -> ControlLoop:
    """Return a loop on the single link after its impulse, unless told otherwise."""
    return ControlLoop(
        link_plant() if plant is None else plant,
        sensing.Impact(IMPULSE) if impact is None else impact,
        controller,
        SwingScorer(band),
        sensing.Clock(sample_time, duration),
        **options,
    )
