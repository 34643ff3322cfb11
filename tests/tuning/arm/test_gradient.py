"""Derivatives by the joints' positions, through the Jacobian, the active set and the eigenvalues."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tuning.kinds.arm.poses import passive_error
from tuning.papers.cartesian.space import open_example
from vsajax import rollout

POSES = 300
STEP = 1e-5


def passive(problem, q):
    design = problem.design(q)
    return passive_error(problem, q), design


def serial(problem, q):
    design = problem.design(q)
    size = jnp.trace(design.desired)
    return ((design.active + 0.3 * design.passive) / size).sum() + design.scale, design


@pytest.mark.slow(
    twin="tests/vsajax/compliance/test_stiffness_design.py::test_a_derivative_is_the_slope_of_the_design"
)
@pytest.mark.gradient
@pytest.mark.parametrize(
    ("loss", "settings"),
    [
        (passive, ()),
        (serial, ()),
        (serial, ("task.load=[5.0,-10.0,8.0]",)),
        (passive, ("arm.preset=lwr-like-7", "arm.pose_deg=[]", "joints.lower=50")),
    ],
    ids=["passive", "serial", "loaded", "seven joints"],
)
def test_slopes_by_position_agree_with_differences_at_300_poses(loss, settings):
    problem, _ = open_example(*settings)
    rng = np.random.default_rng(5)
    poses = jnp.asarray(problem.draw(rng, POSES))
    directions = jnp.asarray(rng.normal(size=poses.shape))

    @eqx.filter_jit
    def slopes(problem):
        def one(lane, own):
            q, direction = lane

            def along(step):
                return loss(own, q + step * direction)

            def value(step):
                return along(step)[0]

            slope = jax.jvp(value, (0.0,), (1.0,))[1]
            (values, designs) = jax.lax.map(along, STEP * jnp.arange(-2.0, 3.0))
            same = (designs.working == designs.working[2]).all() & (designs.status == designs.status[2]).all()
            inside = designs.joint_compliance * (designs.working[2] == 0.0)
            low, high = 1.0 / own.bounds.upper, 1.0 / own.bounds.lower
            held = (inside <= low) | (inside >= high)
            return slope, values, same & (held == held[2]).all()

        arrays, rest = eqx.partition(problem, eqx.is_array)
        return rollout.map_lanes(lambda lane, a: one(lane, eqx.combine(a, rest)), (poses, directions), arrays)

    slope, values, smooth = (np.asarray(part) for part in slopes(problem))
    # The five-point formula. Kinks inside the stencil are told by values alone: its two halves part, or it and the
    # three-point formula do.
    left, right = values[:, 2] - values[:, 1], values[:, 3] - values[:, 2]
    central = (8.0 * (values[:, 3] - values[:, 1]) - (values[:, 4] - values[:, 0])) / (12.0 * STEP)
    curved = np.abs(right - left) / STEP
    parted = np.abs((left + right) / (2.0 * STEP) - central)
    smooth = smooth & (curved < 1e-2 * (1.0 + np.abs(central))) & (parted < 1e-6 * (1.0 + np.abs(central)))
    assert smooth.sum() > 0.85 * POSES
    error = np.abs(slope - central) / (1.0 + np.abs(central))
    assert error[smooth].max() < 1e-6
    assert np.abs(slope[smooth]).max() > 0.1
