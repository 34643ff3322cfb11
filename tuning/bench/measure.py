"""The timing protocol: agreement first, then ours and the other's runs in turn.

Machines are noisy, and differently from minute to minute: a ratio is the median over repeats in each of which both
ran, while nanoseconds are of the fastest run. Compilation is timed apart, from tracing to the executable, with the
compile cache on disk switched off.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from jax.experimental.compilation_cache import compilation_cache

from tuning.bench.opponent import Opponent
from tuning.bench.workload import AGREEMENT, Kernel, Workload

COMPILE_LIMIT = 3.0
"""Seconds that no kernel may take to compile."""
_PEAK_ROUNDS = 1_000_000
_PEAK_REPEATS = 40


@dataclass(frozen=True)
class Row:
    """What was measured of a kernel; `None` where it does not apply.

    Args:
        kernel: its name.
        title: for people.
        lanes: how many.
        samples: of each.
        compile_s: from tracing to the executable [s].
        ns_per_step: of the fastest run, per lane and sample [ns].
        c_ns_per_step: the same of C [ns].
        base_ns_per_step: the same of our own forward run, for the gradient [ns].
        ratio: median over the repeats of our time over C's, or over the forward run's.
        limit: largest ratio allowed.
        ok: whether agreement, ratio and compilation hold.
        difference: largest relative difference to C's results.
        temp_bytes: of the compiled program.
        peak_share: share of the processor's floating-point peak that is reached.
        counting: how floating-point operations were counted.
        note: why it is not ok.
        ns_limit: most that `ns_per_step` may be [ns].
    """

    kernel: str
    title: str
    lanes: int
    samples: int
    compile_s: float
    ns_per_step: float
    c_ns_per_step: float | None
    base_ns_per_step: float | None
    ratio: float | None
    limit: float | None
    ok: bool
    difference: float | None
    temp_bytes: int
    peak_share: float | None
    counting: str
    note: str
    ns_limit: float | None = None


def measure_kernel(
    kernel: Kernel,
    opponent: Opponent | None,
    *,
    repeats: int,
    peak: float | None = None,
    lanes: int | None = None,
    settings: Sequence[str] = (),
) -> Row:
    """Time a kernel.

    Args:
        kernel: which.
        opponent: C, or `None` for ours alone.
        repeats: of ours and the other's run in turn.
        peak: of the processor [flop/ns], see `measure_peak`.
        lanes: instead of the kernel's own number.
        settings: that replace values of its study.
    """
    work = kernel.prepare(lanes or kernel.lanes, settings)
    program = _Ready(work.program, work.arguments)
    compile_s = program.compile_s
    twin = work.twin if opponent is not None else None
    result = jax.block_until_ready(program())
    difference: float | None = None
    other: Callable[[], Any] | None = None
    if opponent is not None and twin is not None:
        difference, other = work.difference(result, twin(opponent)), lambda: twin(opponent)
    elif work.base is not None:
        base = other = _Ready(work.base, work.arguments)
        compile_s = max(compile_s, base.compile_s)
        jax.block_until_ready(base())
    notes = [] if difference is None or difference <= AGREEMENT else [_disagreement(difference)]
    timed = _in_turn([program] if other is None or notes else [program, other], repeats)
    ours, theirs = timed[0], timed[1] if len(timed) > 1 else []
    ratio = statistics.median(a / b for a, b in zip(ours, theirs, strict=True)) if theirs else None
    if ratio is not None and kernel.limit is not None and ratio > kernel.limit:
        notes.append(f"{ratio:.3g} times the other's time; at most {kernel.limit:g} is allowed")
    if compile_s > COMPILE_LIMIT:
        notes.append(f"compiles for {compile_s:.1f} s; at most {COMPILE_LIMIT:g} s is allowed")
    own = 1e9 * min(ours) / work.steps
    if kernel.ns_limit is not None and own > kernel.ns_limit:
        notes.append(f"takes {own:.3g} ns a step; at most {kernel.ns_limit:g} ns is allowed")
    others = 1e9 * min(theirs) / work.steps if theirs else None
    return Row(
        kernel=kernel.name,
        title=kernel.title,
        lanes=work.lanes,
        samples=work.samples,
        compile_s=compile_s,
        ns_per_step=own,
        c_ns_per_step=None if twin is None else others,
        base_ns_per_step=None if work.base is None else others,
        ratio=ratio,
        limit=kernel.limit,
        ok=not notes,
        difference=difference,
        temp_bytes=program.temporary_bytes(),
        peak_share=work.flops / own / peak if peak and work.flops else None,
        counting=kernel.counting,
        note="; ".join(notes),
        ns_limit=kernel.ns_limit,
    )


def nanoseconds_per_step[Key](works: Mapping[Key, Workload], repeats: int) -> dict[Key, float]:
    """Return the time of the fastest of several runs of each, per lane and sample [ns]; all take turns."""
    programs = [_Ready(work.program, work.arguments) for work in works.values()]
    for program in programs:
        jax.block_until_ready(program())
    timed = _in_turn(programs, repeats)
    return {key: 1e9 * min(own) / work.steps for (key, work), own in zip(works.items(), timed, strict=True)}


def temporary_bytes(work: Workload) -> int:
    """Return the memory that the program takes beside its arguments and results [bytes]."""
    return _Ready(work.program, work.arguments).temporary_bytes()


def measure_peak(opponent: Opponent) -> float:
    """Return the floating-point peak of all cores together [flop/ns].

    Measured, by independent chains of fused multiply-adds on every thread; one counts as two operations.
    """

    def run() -> np.ndarray:
        return opponent.call("peak", [opponent.cores], [_PEAK_ROUNDS], [], (opponent.cores,))

    seconds = min(_in_turn([run], _PEAK_REPEATS)[0])
    return 1e-9 * opponent.flops_of_peak(_PEAK_ROUNDS) / seconds


@contextmanager
def _no_cache() -> Iterator[None]:
    """Compile afresh inside the block; whether the cache is used is remembered, so it must be told to forget."""
    was_on = jax.config.jax_enable_compilation_cache
    jax.config.update("jax_enable_compilation_cache", False)
    compilation_cache.reset_cache()
    try:
        yield
    finally:
        jax.config.update("jax_enable_compilation_cache", was_on)
        compilation_cache.reset_cache()


class _Ready:
    """A compiled program with arguments that lie where it reads them, as C's do; calling it runs it.

    jax would otherwise hand every core its share of every array in every call, which takes 2 ms.
    """

    def __init__(self, program: Any, arguments: tuple[Any, ...]) -> None:
        with _no_cache():
            start = time.perf_counter()
            self._compiled = program.lower(*arguments).compile()
            self.compile_s = time.perf_counter() - start
        self._arguments = jax.device_put(arguments, self._compiled.input_shardings[0])

    def __call__(self) -> Any:
        return self._compiled(*self._arguments)

    def temporary_bytes(self) -> int:
        return self._compiled.memory_analysis().temp_size_in_bytes


def _in_turn(runs: Sequence[Callable[[], Any]], repeats: int) -> list[list[float]]:
    """Return the seconds of every repeat of each run, one run right after the other."""

    def seconds(run: Callable[[], Any]) -> float:
        start = time.perf_counter()
        jax.block_until_ready(run())
        return time.perf_counter() - start

    rounds = [[seconds(run) for run in runs] for _ in range(repeats)]
    return [list(own) for own in zip(*rounds, strict=True)]


def _disagreement(difference: float) -> str:
    return f"results differ from C's by {difference:.2g}, more than {AGREEMENT:g}: not timed against it"
