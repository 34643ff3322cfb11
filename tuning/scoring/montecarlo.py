"""A population of robots: every scenario's scores, in resumable chunks, and a design that tells what moves them.

Scenario i is the same robot with the same noise whatever the number of workers, the chunks or their order.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import jax
import jax.numpy as jnp
import numpy as np
import scipy

from tuning.problem.interface import Outcome, Problem, Scenario, problem_of
from tuning.problem.scenarios import stream_key
from tuning.runs.executors import Executor, complete
from tuning.runs.folder import RunStore, open_run
from tuning.runs.forecast import Forecast, foresee
from tuning.runs.sealed import columns_of, read_table
from tuning.scoring.remedies import TARGET
from tuning.scoring.summary import Columns, Summary, quantile, summarise
from tuning.study.base import Study
from tuning.study.paths import numeric_paths
from vsajax import rollout

_STEPS_PER_CHUNK = 4.0e7
"""Lane-steps in a chunk: a few seconds of work. A constant, so that a resumed run has the same chunks."""
_FIRST_LOOK = 2
"""Chunks before the precision is first looked at; then after twice as many, and so on."""
NOISE = "noise draw"
"""The factor of all that the key draws: sensor noise and the clock's jitter."""


@dataclass(frozen=True)
class MonteCarlo:
    """Scenarios of a study and their cut into chunks.

    Args:
        study: the study with its population.
        scenarios: how many robots; unused where there are `rows`.
        rows: of Saltelli's design for Sobol indices, in the population's place; a power of two, or 0.
    """

    study: Study
    scenarios: int
    rows: int = 0

    @classmethod
    def from_plan(cls, study: Study, plan: Mapping[str, Any]) -> Self:
        """Return the run that a manifest describes."""
        return cls(study, plan["scenarios"], plan["rows"])

    @property
    def plan(self) -> dict[str, int]:
        """All that determines the results, beside the study."""
        return {"scenarios": self.scenarios, "rows": self.rows}

    @cached_property
    def problem(self) -> Problem:
        """The study's problem."""
        return problem_of(self.study)

    @property
    def factors(self) -> list[str]:
        """What can be held responsible: the population's independent factors, and the noise."""
        return [*self.study.population.factors, NOISE]

    @property
    def size(self) -> int:
        """Scenarios in all; the design holds matrices A, B, and A with each factor's columns of B."""
        return self.rows * (len(self.factors) + 2) if self.rows else self.scenarios

    @cached_property
    def lanes(self) -> int:
        """Scenarios in a chunk: a power of two, so that Sobol points stay balanced."""
        wanted = min(_STEPS_PER_CHUNK / self.problem.samples, self.size)
        return max(16, 1 << max(0, math.ceil(math.log2(wanted))))

    @property
    def chunks(self) -> list[str]:
        """Ids of the chunks, in order."""
        return [f"{i:06d}" for i in range(math.ceil(self.size / self.lanes))]

    @cached_property
    def _program(self) -> Any:
        def one(scenario: Scenario, given: Any) -> Outcome:
            return self.problem.outcome({}, scenario, given)

        return jax.jit(lambda scenarios, given: rollout.map_lanes(one, scenarios, given))

    def run_chunk(self, chunk: str) -> dict[str, np.ndarray]:
        """Return the rows of a chunk: scenario, the population's numbers, the status and the scores."""
        first = int(chunk) * self.lanes
        count = min(self.lanes, self.size - first)
        # The last chunk is as long as the others, so that all are one compiled program.
        if self.rows:
            drawn = self._design(np.minimum(np.arange(first, first + self.lanes), self.size - 1))
        else:
            drawn = self.problem.scenarios("population", self.lanes, first)
        outcome: Outcome = self._program(drawn, self.problem.given)
        columns = {
            "scenario": np.arange(first, first + self.lanes),
            **drawn.numbers,
            "status": outcome.status,
            **outcome.scores._asdict(),
        }
        return {name: np.asarray(values)[:count] for name, values in columns.items()}

    def _design(self, places: np.ndarray) -> Scenario:
        """Return scenarios of Saltelli's design: matrices A, B, and A with one factor's columns of B each."""
        population = self.study.population
        size, rows = len(population.paths), self.rows
        seed = np.random.default_rng((self.study.seed, 3))
        both = np.clip(scipy.stats.qmc.Sobol(max(1, 2 * size), rng=seed).random(rows), 1e-15, 1.0 - 1e-15)
        matrix, row = places // rows, places % rows
        first, second = both[row, :size], both[row, size : 2 * size]
        # Which columns, and whether the noise, come from B.
        takes = np.zeros((len(self.factors) + 2, size + 1), bool)
        takes[1] = True
        for i, factor in enumerate(self.factors):
            paths = population.factors.get(factor, [])
            takes[2 + i] = [path in paths for path in population.paths] + [factor == NOISE]
        chosen = takes[matrix]
        shares = np.where(chosen[:, :-1], second, first)
        base = stream_key(self.study, "sensitivity")
        keys = jax.vmap(lambda i: jax.random.fold_in(base, i))(jnp.asarray(2 * row + chosen[:, -1]))
        numbers = population.values(shares, numeric_paths(self.study))
        return Scenario(keys, {path: jnp.asarray(values) for path, values in numbers.items()})

    def forecast(self) -> Forecast:
        """Compile and time one chunk."""
        # The results are joined chunk by chunk; the summary holds them once, and a sorted column.
        return foresee(self, [self.chunks], lambda columns: 8 * (len(columns) + 4) * self.size)

    def open(self, folder: Path, *, resume: bool) -> RunStore:
        """Return the run's store."""
        return open_run(folder, "montecarlo", self.study, self.plan, self.chunks, resume=resume)


def run_population(
    population: MonteCarlo,
    folder: Path,
    executor: Executor,
    *,
    rows: int = 0,
    precision: float | None = None,
    worst: int = 5,
    target: float = TARGET,
    resume: bool = False,
    quiet: bool = False,
) -> Summary:
    """Run a population, and a design for Sobol indices in the folder's `design`, and say what they show.

    Args:
        population: what is run.
        folder: the run folder.
        executor: where its chunks are computed.
        rows: of the design; 0 for none.
        precision: stop after the chunks, in order, from which the interval of the objective's 95 % quantile lies
            within this share of it.
        worst: cases to list.
        target: share of the robots that may fail.
        resume: go on with what the folder holds.
        quiet: draw no progress.
    """
    columns = compute_population(population, folder, executor, precision=precision, resume=resume, quiet=quiet)
    objective = population.study.tune.objective
    design = None
    if rows:
        planned = MonteCarlo(population.study, population.scenarios, rows)
        inner = folder / "design"
        beside = planned.open(inner, resume=resume and inner.exists())
        design = columns_of(read_table(complete(beside, executor, f"design {planned.size}", quiet=quiet)))
    study, factors = population.study, population.factors
    options = {"seed": study.seed, "numbers": numeric_paths(study), "target": target}
    return summarise(columns, design, study.population, factors, objective, worst, **options)


def compute_population(
    population: MonteCarlo,
    folder: Path,
    executor: Executor,
    *,
    precision: float | None = None,
    resume: bool = False,
    quiet: bool = False,
) -> Columns:
    """Run a population and return its columns; arguments as those of `run_population`."""
    store = population.open(folder, resume=resume)
    objective = population.study.tune.objective
    count = len(store.chunks) if precision is None else min(_FIRST_LOOK, len(store.chunks))
    while True:
        part = replace(store, manifest={**store.manifest, "chunks": store.chunks[:count]})
        columns = columns_of(read_table(complete(part, executor, f"montecarlo {population.size}", quiet=quiet)))
        if count == len(store.chunks) or _is_precise(columns, objective, precision or math.inf):
            return columns
        count = min(2 * count, len(store.chunks))


def _is_precise(columns: Columns, objective: str, precision: float) -> bool:
    found = quantile(columns[objective][~np.isnan(columns[objective])], 0.95)
    return max(found.high - found.value, found.value - found.low) <= precision * abs(found.value)
