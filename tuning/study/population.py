"""What varies from robot to robot: distributions of any numbers of a study, and what counts as a failure.

Nothing here imports jax. A scenario's numbers follow from the seed and its own number alone, however many are
drawn, in whatever chunks and order.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from tuning.files.errors import input_error
from tuning.files.toml import Table
from tuning.study.parts.base import Positive
from tuning.study.scores import SCORES

_TAIL = 1e-9
"""Share of an unbounded distribution beyond either end of the range that is checked."""
_FAILURE = re.compile(r"^\s*([a-z_]+)\s*(<=|>=|<|>)\s*([-+0-9.eE]+)\s*$")


class _Marginal(Table):
    """One number's distribution; `relative` makes it a factor of the study's own value."""

    relative: bool = False

    def ends(self) -> tuple[float, float]:
        """Return the range in which all but a part in 1e9 of the draws lie."""
        low, high = self.quantile(np.array([_TAIL, 1.0 - _TAIL]))
        return float(low), float(high)

    def quantile(self, share: np.ndarray) -> np.ndarray:
        """Return the values below which given shares of the draws lie."""
        raise NotImplementedError


class Normal(_Marginal):
    """A normal distribution, cut off at `low` and `high` where given."""

    type: Literal["normal"]
    mean: float
    std: Positive
    low: float | None = None
    high: float | None = None

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.low is not None and self.high is not None and self.low >= self.high:
            raise ValueError(f"low must be below high; got {self.low} and {self.high}")
        return self

    def quantile(self, share: np.ndarray) -> np.ndarray:
        """Return the values below which given shares of the draws lie."""
        from scipy import stats

        ends = (-np.inf if self.low is None else self.low, np.inf if self.high is None else self.high)
        a, b = ((end - self.mean) / self.std for end in ends)
        return stats.truncnorm.ppf(share, a, b, self.mean, self.std)


class LogNormal(_Marginal):
    """exp of a normal distribution: half the draws are below `median`, `sigma` is the standard deviation of ln."""

    type: Literal["lognormal"]
    median: Positive
    sigma: Positive

    def quantile(self, share: np.ndarray) -> np.ndarray:
        """Return the values below which given shares of the draws lie."""
        from scipy import stats

        return stats.lognorm.ppf(share, self.sigma, scale=self.median)


class Uniform(_Marginal):
    """Every value between `low` and `high` alike; "loguniform", every decade alike."""

    type: Literal["uniform", "loguniform"]
    low: float
    high: float

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.low < self.high:
            raise ValueError(f"low must be below high; got {self.low} and {self.high}")
        if self.type == "loguniform" and self.low <= 0:
            raise ValueError(f"low must be positive; got {self.low}")
        return self

    def quantile(self, share: np.ndarray) -> np.ndarray:
        """Return the values below which given shares of the draws lie."""
        if self.type == "loguniform":
            return self.low * (self.high / self.low) ** share
        return self.low + (self.high - self.low) * share


class Integer(_Marginal):
    """Every whole number from `low` to `high` alike."""

    type: Literal["integer"]
    low: int
    high: int

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.low < self.high:
            raise ValueError(f"low must be below high; got {self.low} and {self.high}")
        return self

    def quantile(self, share: np.ndarray) -> np.ndarray:
        """Return the values below which given shares of the draws lie."""
        return np.minimum(self.low + np.floor(share * (self.high - self.low + 1)), float(self.high))


class Choice(_Marginal):
    """One of some values, alike or with `weights`."""

    type: Literal["choice"]
    values: Annotated[list[float], Field(min_length=1)]
    weights: list[Positive] | None = None

    @model_validator(mode="after")
    def _weighted(self) -> Self:
        if self.weights is not None and len(self.weights) != len(self.values):
            raise ValueError(f"weights need the length of values, {len(self.values)}; got {len(self.weights)}")
        return self

    def ends(self) -> tuple[float, float]:
        """Return the smallest and the largest value."""
        return min(self.values), max(self.values)

    def quantile(self, share: np.ndarray) -> np.ndarray:
        """Return the values below which given shares of the draws lie."""
        weights = np.ones(len(self.values)) if self.weights is None else np.array(self.weights)
        index = np.searchsorted(np.cumsum(weights)[:-1] / np.sum(weights), share, side="right")
        return np.array(self.values)[index]


class FromFile(_Marginal):
    """Measured values: a column of a CSV or Parquet file, every row alike."""

    type: Literal["file"]
    path: str
    column: str

    @model_validator(mode="after")
    def _readable(self) -> Self:
        _column(self.path, self.column)
        return self

    def ends(self) -> tuple[float, float]:
        """Return the smallest and the largest value."""
        values = _column(self.path, self.column)
        return float(values[0]), float(values[-1])

    def quantile(self, share: np.ndarray) -> np.ndarray:
        """Return the values below which given shares of the draws lie."""
        values = _column(self.path, self.column)
        return values[np.minimum((share * values.size).astype(int), values.size - 1)]


@cache
def _column(path: str, column: str) -> np.ndarray:
    from tuning.logs.columns import read_plain_file

    log = read_plain_file(Path(path))
    if column not in log.names:
        raise input_error(f"{path}: {column}", "no such column", f"it has {', '.join(log.names)}")
    if not log.table.num_rows:
        raise input_error(path, "has no row", "name a file with values")
    return np.sort(log.numbers(column, np.arange(log.table.num_rows)).astype(float))


Distribution = Annotated[Normal | LogNormal | Uniform | Integer | Choice | FromFile, Field(discriminator="type")]


class CorrelatedNormal(Table):
    """Numbers that vary together: a normal distribution with a correlation matrix."""

    paths: Annotated[list[str], Field(min_length=2)]
    mean: list[float]
    std: list[Positive]
    correlation: list[list[float]]
    relative: bool = False

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        size, matrix = len(self.paths), np.array(self.correlation)
        if len(self.mean) != size or len(self.std) != size or matrix.shape != (size, size):
            raise ValueError(f"mean, std and correlation need the size of paths, {size}")
        if not np.allclose(matrix, matrix.T) or not np.allclose(np.diag(matrix), 1.0):
            raise ValueError("correlation must be symmetric with ones on its diagonal")
        if np.linalg.eigvalsh(matrix).min() <= 0:
            raise ValueError("correlation must be positive definite")
        return self

    def quantile(self, shares: np.ndarray) -> np.ndarray:
        """Return `(draw, path)` values at `(draw, path)` shares of independent uniform numbers."""
        from scipy import stats

        factor = np.linalg.cholesky(np.array(self.correlation))
        return np.array(self.mean) + np.array(self.std) * (stats.norm.ppf(shares) @ factor.T)

    def ends(self) -> Iterator[tuple[str, tuple[float, float]]]:
        """Yield the range of each number in which all but a part in 1e9 of the draws lie."""
        from scipy import stats

        reach = float(stats.norm.ppf(1.0 - _TAIL))
        for path, mean, std in zip(self.paths, self.mean, self.std, strict=True):
            yield path, (mean - reach * std, mean + reach * std)


class Population(Table):
    """What varies over a study's scenarios, beside the noise.

    Args:
        sampling: "random", or "sobol": scrambled Sobol points, whose averages converge faster.
        vary: distributions by dotted path.
        correlated: groups of numbers that vary together.
        failures: what counts as a failure, by name, e.g. ``msrep_settled > 1``.
    """

    sampling: Literal["random", "sobol"] = "random"
    vary: dict[str, Distribution] = Field(default_factory=dict)
    correlated: list[CorrelatedNormal] = Field(default_factory=list)
    failures: dict[str, str] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _failures_read(self) -> Self:
        for name, text in self.failures.items():
            parse_failure(name, text)
        paths = self.paths
        twice = sorted({path for path in paths if paths.count(path) > 1})
        if twice:
            raise ValueError(f"vary and correlated name {', '.join(twice)} more than once")
        return self

    @property
    def paths(self) -> list[str]:
        """Dotted paths of all that varies."""
        return [*self.vary, *(path for group in self.correlated for path in group.paths)]

    @property
    def factors(self) -> dict[str, list[str]]:
        """Paths by independent factor: single numbers, and groups that vary together."""
        return {path: [path] for path in self.vary} | {" & ".join(g.paths): g.paths for g in self.correlated}

    def ends(self, numbers: Mapping[str, float]) -> Iterator[tuple[str, float]]:
        """Yield (path, value) at both ends of each number's range; `numbers` are the study's own."""
        for path, marginal in self.vary.items():
            for end in marginal.ends():
                yield path, end * (numbers[path] if marginal.relative else 1.0)
        for group in self.correlated:
            for path, ends in group.ends():
                for end in ends:
                    yield path, end * (numbers[path] if group.relative else 1.0)

    def values(self, shares: np.ndarray, numbers: Mapping[str, float]) -> dict[str, np.ndarray]:
        """Return `(draw,)` values by path at `(draw, path)` shares in (0, 1)."""
        found, column = {}, 0
        for path, marginal in self.vary.items():
            found[path] = marginal.quantile(shares[:, column]) * (numbers[path] if marginal.relative else 1.0)
            column += 1
        for group in self.correlated:
            size = len(group.paths)
            drawn = group.quantile(shares[:, column : column + size])
            for i, path in enumerate(group.paths):
                found[path] = drawn[:, i] * (numbers[path] if group.relative else 1.0)
            column += size
        return found

    def shares(self, seed: tuple[int, ...], start: int, count: int) -> np.ndarray:
        """Return the `(count, path)` shares in (0, 1) of the draws from number `start` on."""
        size = len(self.paths)
        if not size:
            return np.empty((count, 0))
        if self.sampling == "sobol":
            from scipy import stats

            sampler = stats.qmc.Sobol(size, rng=np.random.default_rng(seed))
            with warnings.catch_warnings():
                # Chunks of any size are cut from one sequence, whose balance is that of the whole.
                warnings.simplefilter("ignore", UserWarning)
                shares = (sampler.fast_forward(start) if start else sampler).random(count)
        else:
            # Philox counts in blocks of four numbers: a draw takes whole blocks, so that any can be reached.
            blocks = -(-size // 4)
            generator = np.random.Philox(np.random.SeedSequence(seed)).advance(start * blocks)
            shares = np.random.Generator(generator).random((count, 4 * blocks))[:, :size]
        return np.clip(shares, 1e-15, 1.0 - 1e-15)


def parse_failure(name: str, text: str) -> tuple[str, str, float]:
    """Return the (metric, operator, limit) of a failure's definition.

    Raises:
        ValueError: it is not of that form, or names no metric.
    """
    match = _FAILURE.match(text)
    if match is None or match[1] not in SCORES:
        raise ValueError(
            f"failures.{name} must compare a metric with a number, e.g. 'msrep_settled > 1'; got {text!r}; "
            f"metrics: {', '.join(SCORES)}"
        )
    return match[1], match[2], float(match[3])
