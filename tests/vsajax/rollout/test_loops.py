import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vsajax import rollout

LENGTHS = [1, 2, 7, 10, 100, 101]
SEGMENTS = [None, 1, 3, 10, 1000]


def step(state, inputs):
    """A nonlinear recursion with a pytree state and output."""
    position, velocity = state
    push, damping = inputs["push"], inputs["damping"]
    velocity = velocity * jnp.exp(-damping) + push * jnp.cos(position)
    position = position + 0.1 * velocity
    return (position, velocity), {"position": position, "energy": jnp.stack([velocity**2, position**2])}


def problem(length: int):
    rng = np.random.default_rng(length)
    inputs = {"push": jnp.asarray(rng.normal(size=length)), "damping": jnp.asarray(rng.uniform(size=length))}
    return (jnp.asarray(0.3), jnp.asarray(-0.2)), inputs


def assert_same(left, right):
    # The same operations a step; only fusion, and with it the last bit, may differ.
    for a, b in zip(jax.tree.leaves(left), jax.tree.leaves(right), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-13, atol=1e-14)


@pytest.mark.equivalence
@pytest.mark.parametrize("segment", SEGMENTS)
@pytest.mark.parametrize("length", LENGTHS)
def test_segmented_scan_is_the_plain_scan(length, segment):
    state, inputs = problem(length)
    ours = rollout.scan(step, state, inputs, segment=segment)
    assert_same(ours, jax.lax.scan(step, state, inputs))


@pytest.mark.gradient
@pytest.mark.parametrize(("length", "segment"), [(1, None), (10, 3), (100, None), (101, None), (101, 200)])
def test_reverse_gradients_are_those_of_the_plain_scan(length, segment):
    state, inputs = problem(length)

    def objective(scan):
        def value(state, inputs):
            last, outputs = scan(step, state, inputs)
            return last[0] * last[1] + jnp.sum(jnp.sin(outputs["position"])) + jnp.sum(outputs["energy"])

        return jax.grad(value, argnums=(0, 1))(state, inputs)

    assert_same(objective(lambda *a: rollout.scan(*a, segment=segment)), objective(jax.lax.scan))


@pytest.mark.gradient
def test_forward_gradients_are_those_of_the_plain_scan():
    state, inputs = problem(50)

    def slopes(scan):
        return jax.jacfwd(lambda s: scan(step, s, inputs)[1]["position"])(state)

    assert_same(slopes(rollout.scan), slopes(jax.lax.scan))


@pytest.mark.equivalence
def test_step_may_close_over_what_is_differentiated_and_batched():
    _, inputs = problem(20)

    def last(gain):
        return rollout.scan(lambda s, x: (gain * s + x["push"], None), jnp.asarray(0.0), inputs)[0]

    gains = jnp.asarray([0.5, 0.9])
    together = jax.vmap(jax.grad(last))(gains)
    assert_same(together, jnp.stack([jax.grad(last)(gain) for gain in gains]))


@pytest.mark.equivalence
def test_no_sample_leaves_the_state_as_it_is():
    state, inputs = problem(0)
    last, outputs = rollout.scan(step, state, inputs)
    assert_same(last, state)
    assert outputs["position"].shape == (0,)
    assert outputs["energy"].shape == (0, 2)


@pytest.mark.structure
def test_reverse_memory_grows_with_the_root_of_the_length():
    def temporaries(length: int, scan) -> int:
        def value(x):
            return jnp.sum(scan(lambda s, u: (jnp.sin(s) + u, None), jnp.zeros(1000), x)[0])

        lowered = jax.jit(jax.grad(value)).lower(jax.ShapeDtypeStruct((length,), jnp.float64))
        return lowered.compile().memory_analysis().temp_size_in_bytes

    # A hundredfold length: ten times the states, each of 8 kB; storing every state takes a hundred times.
    ours, plain = (temporaries(40_000, scan) / temporaries(400, scan) for scan in (rollout.scan, jax.lax.scan))
    assert ours < 15
    assert plain > 90


@pytest.mark.structure
@pytest.mark.parametrize("in_axis", [0, 1])
def test_inputs_are_not_copied(in_axis):
    # 4 MB of inputs, lanes first or last, a length that leaves a rest: cut out segment by segment, not up front.
    shape = (50, 10_007) if in_axis == 0 else (10_007, 50)

    def last(x):
        return rollout.scan(lambda s, u: (0.5 * s + u, None), jnp.asarray(0.0), x)[0]

    lowered = jax.jit(jax.vmap(last, in_axes=in_axis)).lower(jax.ShapeDtypeStruct(shape, jnp.float64))
    assert lowered.compile().memory_analysis().temp_size_in_bytes < 0.1 * 8 * 50 * 10_007


@pytest.mark.failure
@pytest.mark.parametrize("segment", [0, -3])
def test_segment_must_be_positive(segment):
    with pytest.raises(ValueError, match=rf"segment must be at least 1; got {segment}"):
        rollout.scan(step, *problem(5), segment=segment)


@pytest.mark.failure
@pytest.mark.parametrize(
    ("inputs", "found"),
    [
        ((jnp.zeros(3), jnp.zeros(4)), "3, 4"),
        ((), "no array"),
        ((jnp.zeros(3), jnp.asarray(0.0)), "a scalar, 3"),
    ],
    ids=["unequal", "none", "scalar"],
)
def test_inputs_must_share_one_length(inputs, found):
    with pytest.raises(ValueError, match=rf"inputs need one leading length; got {found}"):
        rollout.scan(lambda s, x: (s, None), jnp.asarray(0.0), inputs)


@pytest.mark.structure
@pytest.mark.parametrize(("steps", "loops"), [(10001, 1), (2001, 1), (1000, 1), (10007, 2)])
def test_the_step_is_compiled_once_where_the_steps_divide(steps, loops):
    # 10007 is prime: what its segments leave over needs a loop of its own.
    text = jax.jit(lambda x: rollout.scan(lambda s, u: (s + jnp.tanh(u), None), 0.0, x)).lower(jnp.ones(steps))
    assert text.as_text().count("stablehlo.tanh") == loops
