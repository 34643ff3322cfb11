"""The scenarios of a study: noise, and the robots of its population, drawn from streams of its seed."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Key

from tuning.problem.interface import Scenario, Stream
from tuning.study.base import Study
from tuning.study.paths import numeric_paths

_STREAMS: dict[Stream, int] = {"train": 0, "held_out": 1, "population": 2, "sensitivity": 3}


def stream_key(study: Study, stream: Stream) -> Key[Array, ""]:
    """Return the key from which a stream's scenarios are drawn."""
    return _key(study.seed, _STREAMS[stream])


def draw_scenarios(study: Study, stream: Stream, count: int, start: int = 0) -> Scenario:
    """Return the scenarios `start`, `start` + 1, …: each is the same however many are drawn.

    Args:
        study: its seed and population.
        stream: scenarios of one stream are independent of those of the others.
        count: how many.
        start: number of the first.
    """
    keys = _keys(stream_key(study, stream), start, count)
    shares = study.population.shares((study.seed, _STREAMS[stream]), start, count)
    numbers = study.population.values(shares, numeric_paths(study))
    return Scenario(keys, {path: jnp.asarray(values) for path, values in numbers.items()})


def numbered_scenarios(study: Study, stream: Stream, numbers: Sequence[int]) -> Scenario:
    """Return the scenarios of a stream that have these numbers, in this order."""
    each = [draw_scenarios(study, stream, 1, number) for number in numbers]
    return jax.tree.map(lambda *parts: jnp.concatenate(parts), *each)


@jax.jit
def _key(seed: int, stream: int) -> Key[Array, ""]:
    return jax.random.fold_in(jax.random.key(seed), stream)


@partial(jax.jit, static_argnames="count")
def _keys(base: Key[Array, ""], start: int, count: int) -> Key[Array, " count"]:
    return jax.vmap(partial(jax.random.fold_in, base))(start + jnp.arange(count))
