"""What a run will take, from one timed chunk of each of its programs."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from tuning.runs.workers import Columns, Planner


@dataclass(frozen=True)
class Forecast:
    """What a run will take.

    Args:
        chunks: into which the work is cut.
        memory: peak of the process [bytes].
        compile_time: [s].
        run_time: of all chunks together, compilation apart [s].
    """

    chunks: int
    memory: int
    compile_time: float
    run_time: float


def foresee(run: Planner, programs: Iterable[Sequence[str]], table: Callable[[Columns], int]) -> Forecast:
    """Compile and time a chunk of every program.

    Args:
        run: what would be computed.
        programs: the chunks of each.
        table: of the columns of a chunk, the bytes of the whole run's results where they are joined.
    """
    compile_time = run_time = 0.0
    results = 0
    for chunks in programs:
        (first, columns), (again, _) = (_timed(run, chunks[0]) for _ in range(2))
        # The second takes longer where others use the machine: what compiling took is then not known.
        compile_time += max(first - again, 0.0)
        run_time += min(first, again) * len(chunks)
        results = max(results, table(columns))
    # Linux counts in KiB; the resident peak holds the programs, their inputs and one chunk's results.
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    return Forecast(len(run.chunks), peak + results, compile_time, run_time)


def _timed(run: Planner, chunk: str) -> tuple[float, Columns]:
    start = time.perf_counter()
    columns = run.run_chunk(chunk)
    return time.perf_counter() - start, columns
