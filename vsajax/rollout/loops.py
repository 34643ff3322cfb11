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

LANES_PER_CHUNK = 16
Dimension = Any
"""An int, a symbolic dimension while a program of any length is exported, or `None`."""


def scan[State](
    step: Callable[[State, Any], tuple[State, Any]],
    state: State,
    inputs: PyTree,
    *,
    segment: Dimension | None = None,
) -> tuple[State, PyTree]:
    """Run `step` over the leading axis of `inputs`.

    The loop is cut into checkpointed segments: the reverse pass stores one state a segment and recomputes the
    rest, so that its memory is that of `steps / segment + segment` states instead of `steps`.

    Args:
        step: (state, input) -> (state, output); pure.
        state: the first state.
        inputs: arrays with a leading time axis of one length.
        segment: samples a segment; by default near the square root of their number. 1 ≤ segment.

    Returns:
        The last state, and the outputs with a leading time axis.

    Raises:
        ValueError: `inputs` have no array, unequal lengths, or `segment` is below 1.
    """
    steps = _common_length("inputs", inputs)
    if segment is not None and segment < 1:
        raise ValueError(f"segment must be at least 1; got {segment}")
    length = min(segment or _segment_of(steps), steps)
    segments = steps // length if length else 0

    @partial(jax.checkpoint, prevent_cse=False, static_argnums=2)  # pyright: ignore[reportPrivateImportUsage]
    def run(state: State, start: Any, length: Dimension) -> tuple[State, PyTree]:
        # Cut out here, inputs are neither copied nor stored as residuals, as they are when reshaped up front.
        part = jax.tree.map(lambda x: jax.lax.dynamic_slice_in_dim(x, start, length), inputs)
        # The lambda hides what `step` closes over: bound methods of modules with traced leaves have no hash.
        return jax.lax.scan(lambda s, x: step(s, x), state, part)

    starts = jnp.arange(segments) * length
    state, outputs = jax.lax.scan(lambda s, start: run(s, start, length), state, starts)
    outputs = jax.tree.map(lambda y: y.reshape(segments * length, *y.shape[2:]), outputs)
    if segments * length == steps:
        return state, outputs
    state, tail = run(state, segments * length, steps - segments * length)
    return state, jax.tree.map(lambda a, b: jnp.concatenate([a, b]), outputs, tail)


def repeat[State](step: Callable[[State], State], state: State, *, times: int) -> State:
    """Apply `step` a fixed number of times, as an iteration that converges does; nothing is kept on the way."""
    return jax.lax.scan(lambda s, _: (step(s), None), state, None, length=times)[0]


def map_lanes(
    function: Callable[..., PyTree], lanes: PyTree, shared: PyTree = None, *, chunk: int = LANES_PER_CHUNK
) -> PyTree:
    """Apply `function` to every lane: `vmap` in chunks, the chunks shared out over all local devices.

    A batch that outgrows the first cache makes every step wait for the second: with a covariance of 18 × 18 a lane
    chunks of 32 lanes take a fifth to a half longer than of 16. Fewer than 16 leave vectors unfilled. Lanes are
    padded to whole chunks by repeating the last one, so results do not depend on how many there are.

    Args:
        function: (lane, shared) -> results; pure.
        lanes: a pytree whose arrays have one common leading lane axis.
        shared: a pytree that every lane sees whole.
        chunk: lanes evaluated at a time on a device. 1 ≤ chunk.

    Returns:
        What `function` returns, with a leading lane axis.

    Raises:
        ValueError: `lanes` has no array, unequal lengths or no lane, or `chunk` is below 1.
    """
    count = _common_length("lanes", lanes)
    if count < 1 or chunk < 1:
        raise ValueError(f"map_lanes needs at least one lane and a chunk of at least 1; got {count} and {chunk}")
    devices = jax.local_devices()
    used = min(len(devices), count)
    chunk = min(chunk, math.ceil(count / used))
    padded = math.ceil(count / (used * chunk)) * used * chunk

    def pad(x: jax.Array) -> jax.Array:
        return jnp.concatenate([x, jnp.repeat(x[-1:], padded - count, axis=0)]) if padded > count else x

    def share(own: PyTree, common: PyTree) -> PyTree:
        return jax.lax.map(lambda lane: function(lane, common), own, batch_size=chunk)

    mesh = Mesh(np.asarray(devices[:used]), ("lane",))
    own, common = PartitionSpec("lane"), PartitionSpec()
    spread = jax.shard_map(share, mesh=mesh, in_specs=(own, common), out_specs=own, check_vma=False)
    results = spread(jax.tree.map(pad, lanes), shared)
    return jax.tree.map(lambda y: y[:count], results)


def divisor_near(steps: int, length: int) -> int:
    """Return a divisor of `steps` within a factor of two of `length`, else `length`.

    Segments of that length leave no shorter one, whose loop would be compiled a second time.
    """
    near = [n for n in range(max(length // 2, 1), 2 * length + 1) if steps % n == 0]
    return min(near, key=lambda n: abs(math.log(n / length)), default=length)


def _segment_of(steps: int) -> int:
    """Return a length near √steps that leaves no shorter segment, whose loop would be compiled a second time."""
    root = math.isqrt(steps)
    divisors = [n for n in range(max(root // 4, 1), 4 * root + 1) if steps % n == 0]
    return min(divisors, key=lambda n: n + steps // n, default=root)


def _common_length(name: str, tree: PyTree) -> Dimension:
    lengths = {jnp.shape(leaf)[:1] for leaf in jax.tree.leaves(tree)}
    if len(lengths) != 1 or () in lengths:
        found = ", ".join(str(*length) or "a scalar" for length in sorted(lengths)) or "no array"
        raise ValueError(f"{name} need one leading length; got {found}")
    ((length,),) = lengths
    return length
