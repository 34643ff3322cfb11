import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vsajax import rollout

COUNTS = [1, 2, 5, 64, 130]


def simulate(lane, shared):
    """A recursion per lane with a shared input, scalar and series outputs, and a key."""
    gain, key = lane
    noise = jax.random.normal(key, shared.shape)
    last, series = rollout.scan(
        lambda s, x: (gain * s + x[0] + 0.1 * x[1], jnp.sin(s)), jnp.asarray(0.0), (shared, noise)
    )
    return {"last": last, "series": series}


def lanes(count: int):
    return jnp.linspace(0.1, 0.9, count), jax.random.split(jax.random.key(0), count)


def assert_same(left, right):
    for a, b in zip(jax.tree.leaves(left), jax.tree.leaves(right), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-13, atol=1e-14)


@pytest.mark.equivalence
@pytest.mark.parametrize("count", COUNTS)
def test_mapped_lanes_are_vmapped_lanes(count):
    assert jax.local_device_count() == 2
    shared = jnp.linspace(-1.0, 1.0, 20)
    ours = jax.jit(lambda x: rollout.map_lanes(simulate, x, shared))(lanes(count))
    assert_same(ours, jax.vmap(simulate, in_axes=(0, None))(lanes(count), shared))
    assert ours["series"].shape == (count, 20)


@pytest.mark.equivalence
@pytest.mark.parametrize("chunk", [1, 3, 1000])
def test_chunk_does_not_change_results(chunk):
    shared = jnp.linspace(-1.0, 1.0, 20)
    ours = jax.jit(lambda x: rollout.map_lanes(simulate, x, shared, chunk=chunk))(lanes(11))
    assert_same(ours, jax.vmap(simulate, in_axes=(0, None))(lanes(11), shared))


@pytest.mark.equivalence
def test_results_do_not_depend_on_the_other_lanes():
    shared = jnp.linspace(-1.0, 1.0, 20)
    run = jax.jit(lambda x: rollout.map_lanes(simulate, x, shared))
    gains, keys = lanes(70)
    whole, part = run((gains, keys)), run((gains[:5], keys[:5]))
    assert_same(jax.tree.map(lambda x: x[:5], whole), part)


@pytest.mark.gradient
def test_gradients_pass_through_shared_values_and_lanes():
    shared = jnp.linspace(-1.0, 1.0, 8)

    def total(run):
        def value(gains, shared):
            return jnp.sum(run((gains, keys), shared)["last"] ** 2)

        return jax.jit(jax.grad(value, argnums=(0, 1)))(gains, shared)

    gains, keys = lanes(5)
    ours = total(lambda x, s: rollout.map_lanes(simulate, x, s, chunk=2))
    assert_same(ours, total(jax.vmap(simulate, in_axes=(0, None))))


@pytest.mark.structure
def test_work_is_shared_out_over_all_devices():
    # Every device holds its own lanes and no other: nothing is gathered or reduced on the way.
    run = jax.jit(lambda x: rollout.map_lanes(simulate, x, jnp.zeros(4)))
    results = run(lanes(128))
    assert results["last"].sharding.device_set == set(jax.local_devices())
    text = run.lower(lanes(128)).compile().as_text()
    assert not any(word in text for word in ("all-gather", "all-reduce", "all-to-all", "collective-permute"))


@pytest.mark.failure
@pytest.mark.parametrize(
    ("lanes", "found"),
    [((jnp.zeros(3), jnp.zeros(4)), "3, 4"), ((), "no array"), (jnp.asarray(1.0), "a scalar")],
    ids=["unequal", "none", "scalar"],
)
def test_lanes_must_share_one_length(lanes, found):
    with pytest.raises(ValueError, match=rf"lanes need one leading length; got {found}"):
        rollout.map_lanes(lambda lane, _: lane, lanes)


@pytest.mark.failure
def test_there_must_be_a_lane_and_a_chunk():
    words = f"at least one lane and a chunk of at least 1; got 0 and {rollout.LANES_PER_CHUNK}"
    with pytest.raises(ValueError, match=words):
        rollout.map_lanes(lambda lane, _: lane, jnp.zeros(0))
    with pytest.raises(ValueError, match="got 3 and 0"):
        rollout.map_lanes(lambda lane, _: lane, jnp.zeros(3), chunk=0)
