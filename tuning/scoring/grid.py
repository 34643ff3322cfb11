"""Scores on a grid of values × scenarios, with everything that axes share computed once.

Axes that only touch the torque signal (K_I, torque noise) leave regressors and covariance untouched, so they
are nested `vmap`s of their own inside every lane: the covariance recursion runs once for all of them. The
remaining axes make the lanes, which `rollout.map_lanes` spreads over chunks and cores.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from tuning.problem.interface import Problem, Scenario, Stream
from tuning.study.ranges import Reach
from vsajax import rollout


def lane_program(problem: Problem, outer: tuple[str, ...], inner: tuple[str, ...], *, width: int) -> Any:
    """Return the jitted (lanes, given) -> scores `(lane, *inner axes, scenario)`.

    A lane is the values of the `outer` paths, a tuple of values of each of the `inner` paths, and its scenarios;
    inner paths, which must be torque-only, are nested inside it. `width` is the number of evaluations in a lane.
    """

    def point(lane: tuple[jax.Array, tuple[jax.Array, ...], Scenario], given: Any) -> Any:
        values, inner_values, scenarios = lane
        fixed = {path: values[i] for i, path in enumerate(outer)}

        def score(chosen: tuple[jax.Array, ...], scenario: Scenario) -> Any:
            return problem.outcome(fixed | dict(zip(inner, chosen, strict=True)), scenario, given).scores

        run = jax.vmap(score, in_axes=(None, 0))
        for axis in reversed(range(len(inner))):
            chosen_axes = tuple(0 if i == axis else None for i in range(len(inner)))
            run = jax.vmap(run, in_axes=(chosen_axes, None))
        return run(inner_values, scenarios)

    return jax.jit(partial(rollout.map_lanes, point, chunk=max(1, problem.lanes // width)))


@dataclass(frozen=True)
class Grid:
    """Every combination of some axes, each on the same scenarios.

    Args:
        problem: what is evaluated.
        axes: values by dotted path; configurations are numbered with the last axis running fastest.
        scenarios: noise draws per configuration.
        stream: where they are drawn from.
    """

    problem: Problem
    axes: Mapping[str, Sequence[float]]
    scenarios: int
    stream: Stream = "train"

    @cached_property
    def inner(self) -> tuple[str, ...]:
        """Axes that share the covariance."""
        return tuple(path for path in self.axes if Reach.REGRESSORS not in self.problem.study.reach(path))

    @cached_property
    def outer(self) -> tuple[str, ...]:
        """Axes that make the lanes."""
        return tuple(path for path in self.axes if path not in self.inner)

    @property
    def configurations(self) -> int:
        """Number of points of the grid."""
        return math.prod(len(values) for values in self.axes.values())

    @cached_property
    def outer_points(self) -> np.ndarray:
        """`(point, axis)` values of the outer axes; one empty point where there is none."""
        if not self.outer:
            return np.empty((1, 0))
        each = np.meshgrid(*(np.asarray(self.axes[path], float) for path in self.outer), indexing="ij")
        return np.stack([values.reshape(-1) for values in each], axis=1)

    @property
    def outer_count(self) -> int:
        """Number of outer points."""
        return math.prod(len(self.axes[path]) for path in self.outer)

    @property
    def inner_size(self) -> int:
        """Points that share one covariance: inner configurations times scenarios."""
        return math.prod(len(self.axes[path]) for path in self.inner) * self.scenarios

    @cached_property
    def configuration_of(self) -> np.ndarray:
        """`(outer point, inner point)` numbers of the configurations."""
        shape = [len(values) for values in self.axes.values()]
        numbers = np.arange(self.configurations).reshape(shape)
        order = [list(self.axes).index(path) for path in (*self.outer, *self.inner)]
        return np.transpose(numbers, order).reshape(len(self.outer_points), -1)

    def values_of(self, configuration: int) -> dict[str, float]:
        """Return a configuration's values by path."""
        shape = [len(values) for values in self.axes.values()]
        index = np.unravel_index(configuration, shape)
        return {path: values[int(i)] for (path, values), i in zip(self.axes.items(), index, strict=True)}

    @cached_property
    def _cut(self) -> tuple[int, int]:
        """Into how many lanes a point's longest inner axis, and its scenarios, are cut.

        A lane wider than the problem's `lanes` falls out of the cache. The axis is cut first: scenarios are what
        the compiled loops run over. Scenarios are cut as well where there are fewer lanes than cores.
        """
        axis = len(self.axes[self.inner[self._longest]]) if self.inner else 1
        most = self.problem.lanes
        across = next(d for d in _divisors(axis) if self.inner_size // d <= most or d == axis)
        width, lanes = self.inner_size // across, len(self.outer_points) * across
        along = (d for d in _divisors(self.scenarios) if width // d <= most)
        cores = len(jax.local_devices())
        return across, next((d for d in along if lanes * d >= cores), self.scenarios)

    @cached_property
    def _longest(self) -> int:
        """Number of the inner axis with the most values."""
        return max(range(len(self.inner)), key=lambda i: len(self.axes[self.inner[i]]))

    @cached_property
    def program(self) -> Any:
        """The compiled (lanes, given) -> scores `(lane, *inner axes, scenario)`."""
        return lane_program(self.problem, self.outer, self.inner, width=self.inner_size // math.prod(self._cut))

    def arguments(self, points: np.ndarray) -> tuple[Any, Any]:
        """Return the program's arguments for some outer points: a lane for each of their parts."""
        across, along = self._cut
        drawn = self.problem.scenarios(self.stream, self.scenarios)
        scenarios = _dealt(drawn, along, len(points) * across)

        def spread(i: int, path: str) -> np.ndarray:
            values = np.asarray(self.axes[path], float)
            parts = values.reshape(across if i == self._longest else 1, -1)
            parts = np.broadcast_to(parts, (across, parts.shape[1]))
            return np.tile(np.repeat(parts, along, axis=0), (len(points), 1))

        inner = tuple(spread(i, path) for i, path in enumerate(self.inner))
        outer = np.repeat(np.asarray(points, float), across * along, axis=0)
        return (outer, inner, scenarios), self.problem.given

    def arrange(self, score: Any) -> np.ndarray:
        """Return a score of the program's lanes as `(point, inner point, scenario)`."""
        across, along = self._cut
        sizes = [len(self.axes[path]) for path in self.inner]
        before = math.prod(sizes[: self._longest]) if sizes else 1
        whole = sizes[self._longest] if sizes else 1
        # From lane (point, part of the axis, part of the scenarios) × (axes before, axis, axes after, scenario).
        parts = np.asarray(score).reshape(
            -1,
            across,
            along,
            before,
            whole // across,
            math.prod(sizes) // before // whole,
            self.scenarios // along,
        )
        points = parts.shape[0]
        return np.transpose(parts, (0, 3, 1, 4, 5, 2, 6)).reshape(points, -1, self.scenarios)

    def evaluate(self, points: np.ndarray) -> dict[str, np.ndarray]:
        """Return each score at some outer points, `(point, inner point, scenario)`."""
        scores = self.program(*self.arguments(points))
        return {name: self.arrange(value) for name, value in scores._asdict().items()}

    def memory(self, points: int) -> int:
        """Return the bytes that a compiled evaluation of some outer points needs."""
        analysis = self.program.lower(*self.arguments(self.outer_points[:points])).compile().memory_analysis()
        return analysis.temp_size_in_bytes + analysis.argument_size_in_bytes + analysis.output_size_in_bytes


@partial(jax.jit, static_argnums=(1, 2))
def _dealt(drawn: Scenario, hands: int, times: int) -> Scenario:
    """Return scenarios cut into so many hands, `(times * hands, scenarios of a hand)`."""
    return jax.tree.map(lambda x: jnp.tile(x.reshape(hands, -1), (times, 1)), drawn)


def _divisors(number: int) -> list[int]:
    return [d for d in range(1, number + 1) if number % d == 0]
