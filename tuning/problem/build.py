"""From the tables of a study to the modules of vsajax, and to single numbers in them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import reduce
from typing import Any

import equinox as eqx
import jax

import vsajax
from tuning.study.base import Config
from tuning.study.parts.base import Part


def build(part: Any) -> Any:
    """Return the module that a table describes; anything but a table is returned as it is."""
    if not isinstance(part, Part):
        return part
    return part.target.load()(**{key: build(value) for key, value in part.arguments().items()})


def build_estimator(config: Config) -> vsajax.estimators.AbstractEstimator:
    """Return the estimator of a study or of a configuration without a joint."""
    return build(config.estimator)


def number(bench: Any, path: str) -> jax.Array:
    """Return the number at a dotted path of the study, from the built object that the path starts in."""
    return reduce(getattr, path.split("."), bench)


def with_leaves[Model](bench: Model, leaves: Mapping[str, jax.Array]) -> Model:
    """Return the bench with leaves at dotted paths replaced."""
    if not leaves:
        return bench
    paths: Sequence[str] = list(leaves)
    return eqx.tree_at(lambda b: [number(b, path) for path in paths], bench, [leaves[path] for path in paths])
