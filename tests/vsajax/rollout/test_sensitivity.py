"""Normal equations of a loop against its full Jacobian."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.vsajax.programs import held_shapes, scans
from vsajax.rollout import sensitivity

WIDE = 7


class Chain(eqx.Module):
    """x ← x + a u, y ← 0.9 y + x, with a wide state w that nothing moves, and a counter."""

    gain: jax.Array

    def __call__(self, state, sample):
        x, y, wide, count = state
        x = x + self.gain * sample
        y = 0.9 * y + x
        return (x, y, 0.5 * wide + sample, count + 1), jnp.sin(y) * wide[0] - sample


def loop_at(parameters: jax.Array) -> sensitivity.Loop:
    gain, start, scale = parameters
    state = (start, jnp.asarray(0.0), jnp.ones(WIDE), 0)
    return sensitivity.Loop(Chain(gain), state, scale * jnp.cos(0.3 * jnp.arange(30.0)))


def still_inputs(parameters: jax.Array) -> sensitivity.Loop:
    return loop_at(parameters)._replace(inputs=jnp.cos(0.3 * jnp.arange(30.0)))


AT = jnp.array([0.3, -0.2, 1.4])


@pytest.mark.equivalence
@pytest.mark.parametrize("loop_at", [loop_at, still_inputs], ids=["moving inputs", "still inputs"])
def test_normal_equations_are_those_of_the_full_jacobian(loop_at):
    ours = jax.jit(lambda p: sensitivity.normal_equations(loop_at, p))(AT)
    residuals = sensitivity.run(loop_at(AT))
    jacobian = jax.jacfwd(lambda p: sensitivity.run(loop_at(p)))(AT)
    whole = jnp.concatenate([jacobian, residuals[:, None]], axis=1)
    # Sums of 30 products in another order.
    np.testing.assert_allclose(ours, whole.T @ whole, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(sensitivity.sum_of_squares(loop_at(AT)), residuals @ residuals, rtol=1e-13)


@pytest.mark.structure
def test_only_what_moves_has_a_sensitivity():
    program = jax.make_jaxpr(lambda p: sensitivity.normal_equations(still_inputs, p))(AT)
    for loop in scans(program):
        shapes = held_shapes(loop)
        # x and y move, y only because x does, beside the gain; the wide state and the counter do not.
        assert shapes.count((3,)) == 3
        assert (3, WIDE) not in shapes


def test_what_does_not_move_at_all_gives_zero_columns():
    def constant(parameters):
        return still_inputs(AT)

    square = sensitivity.normal_equations(constant, AT)
    assert np.all(np.asarray(square)[:3] == 0.0)
    assert square[-1, -1] > 0.0
