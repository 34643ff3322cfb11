"""The one place that runs things over time and over lanes.

`scan` is the loop over samples: two-level checkpointed, so that reverse-mode memory grows with the square root
of the number of steps. `map_lanes` is the loop over independent lanes (joints, configurations, noise draws):
chunks small enough for the cache, spread over all local devices.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, PartitionSpec
from jaxtyping import PyTree

LANES_PER_CHUNK = 64


def scan[State](
    step: Callable[[State, Any], tuple[State, Any]], state: State, inputs: PyTree, *, segment: int | None = None
) -> tuple[State, PyTree]:
    """Run `step` over the leading axis of `inputs`.

    The loop is cut into checkpointed segments: the reverse pass stores one state a segment and recomputes the
    rest, so that its memory is that of `steps / segment + segment` states instead of `steps`.

    Args:
        step: (state, input) -> (state, output); pure.
        state: the first state.
        inputs: arrays with a leading time axis of one length.
        segment: samples a segment; by default the square root of their number. 1 ≤ segment.

    Returns:
        The last state, and the outputs with a leading time axis.

    Raises:
        ValueError: `inputs` have no array, unequal lengths, or `segment` is below 1.
    """
    lengths = {leaf.shape[0] for leaf in jax.tree.leaves(inputs)}
    if len(lengths) != 1:
        raise ValueError(f"inputs need one leading length; got {sorted(lengths) or 'no array'}")
    (steps,) = lengths
    length = segment or max(1, math.isqrt(steps))
    if length < 1:
        raise ValueError(f"segment must be at least 1; got {segment}")
    segments = steps // length

    @partial(jax.checkpoint, prevent_cse=False)  # pyright: ignore[reportPrivateImportUsage]
    def body(state: State, inputs: PyTree) -> tuple[State, PyTree]:
        # The lambda hides what `step` closes over: bound methods of modules with traced leaves have no hash.
        return jax.lax.scan(lambda s, x: step(s, x), state, inputs)

    whole = jax.tree.map(lambda x: x[: segments * length].reshape(segments, length, *x.shape[1:]), inputs)
    rest = jax.tree.map(lambda x: x[segments * length :], inputs)
    state, outputs = jax.lax.scan(body, state, whole)
    outputs = jax.tree.map(lambda y: y.reshape(segments * length, *y.shape[2:]), outputs)
    if segments * length == steps:
        return state, outputs
    state, tail = body(state, rest)
    return state, jax.tree.map(lambda a, b: jnp.concatenate([a, b]), outputs, tail)


def map_lanes(function: Callable[..., PyTree], *lanes: PyTree, chunk: int = LANES_PER_CHUNK) -> PyTree:
    """Apply `function` to every lane: `vmap` in chunks, the chunks shared out over all local devices.

    A batch that outgrows the cache makes every step wait for memory; chunks of 32 to 256 lanes do not. Lanes
    are padded to whole chunks by repeating the last one, so results do not depend on how many there are.

    Args:
        function: takes one lane of each argument; pure.
        *lanes: pytrees whose arrays have one common leading lane axis.
        chunk: lanes evaluated at a time on a device. 1 ≤ chunk.

    Returns:
        What `function` returns, with a leading lane axis.
    """
    (count,) = {leaf.shape[0] for leaf in jax.tree.leaves(lanes)}
    devices = jax.local_devices()
    used = min(len(devices), count)
    chunk = min(chunk, math.ceil(count / used))
    padded = math.ceil(count / (used * chunk)) * used * chunk

    def pad(x: jax.Array) -> jax.Array:
        return jnp.concatenate([x, jnp.repeat(x[-1:], padded - count, axis=0)]) if padded > count else x

    def share(arguments: PyTree) -> PyTree:
        return jax.lax.map(lambda one: function(*one), arguments, batch_size=chunk)

    mesh = Mesh(np.asarray(devices[:used]), ("lane",))
    spec = PartitionSpec("lane")
    spread = jax.shard_map(share, mesh=mesh, in_specs=(spec,), out_specs=spec, check_vma=False)
    results = spread(jax.tree.map(pad, lanes))
    return jax.tree.map(lambda y: y[:count], results)
