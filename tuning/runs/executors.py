"""Where the chunks of a run are computed: in this process, by Dask workers, or in SLURM jobs.

An executor is told what to compute and yields what it gets, in any order. Only the process that the user started
writes to the run folder, so that a worker can be lost at any time.
"""

from __future__ import annotations

import logging
import shutil
import signal
import sys
import threading
import time
import uuid
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from importlib import util
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any, Literal, Protocol

from tuning.files.errors import InputError, input_error
from tuning.runs.folder import RunStore
from tuning.runs.scheduler import CONNECT_WITHIN, Patience, require_scheduler, unreachable
from tuning.runs.sealed import columns_of, is_file, read_sealed
from tuning.runs.workers import (
    Columns,
    planner_of,
    require_plugins,
    result_file,
    run_chunk,
    run_of,
    run_share,
    spec_of,
    uses_plugins,
)
from tuning.terminal.progress import progress

Results = Generator[tuple[str, Columns], None, None]

_LOSSES = 10
"""Workers that may be lost with a chunk on them before the chunk is taken for the cause."""
_TRIES = 3
"""Jobs in a row that may end without a single chunk."""
_JOB_MINUTES = 60
_LOOK_EVERY = 0.2
_POLL_EVERY = 0.02


class Executor(Protocol):
    """Where chunks are computed."""

    def compute(self, spec: str, chunks: Sequence[str]) -> Results:
        """Yield the columns of every chunk as they come, in any order; closing it stops the work."""
        ...


def complete(store: RunStore, executor: Executor, label: str, *, quiet: bool = False) -> Path:
    """Compute every unfinished chunk of a run and return its `results.parquet`.

    Args:
        store: the run.
        executor: where its chunks are computed.
        label: of the progress bar.
        quiet: draw none.

    Raises:
        InputError: the disk is full, or the workers cannot be had.
    """
    pending = list(store.pending())
    with progress(label, len(store.chunks), quiet=quiet) as advance:
        advance(len(store.chunks) - len(pending))
        if pending:
            with closing(executor.compute(spec_of(store.manifest), pending)) as results:
                for chunk, columns in results:
                    store.write_chunk(chunk, columns)
                    advance()
    return store.finish()


@dataclass(frozen=True)
class Inline:
    """One chunk after another in this process, each on all of its cores."""

    def compute(self, spec: str, chunks: Sequence[str]) -> Results:
        """Yield the chunks in order."""
        planner = planner_of(spec)
        for chunk in chunks:
            yield chunk, planner.run_chunk(chunk)


@dataclass(frozen=True)
class DaskExecutor:
    """Dask workers: processes of this machine, or those of a scheduler that runs already.

    A worker that is lost is started again by whoever keeps it, and its chunks go to others.

    Args:
        workers: processes to start, each computing one chunk at a time.
        scheduler: address of a running scheduler instead, e.g. ``tcp://node:8786``.
        wait: time without workers after which a run with that scheduler is given up [s]; `None`: never.
    """

    workers: int = 1
    scheduler: str | None = None
    wait: float | None = None

    def __post_init__(self):
        _require("distributed")

    def compute(self, spec: str, chunks: Sequence[str]) -> Results:
        """Yield the chunks as workers finish them."""
        import distributed

        with self._client(len(chunks)) as client:
            if uses_plugins(spec):
                # All of them are asked ahead of the first chunk; one that joins later asks itself.
                client.run(require_plugins, spec)
            futures = client.map(run_chunk, [spec] * len(chunks), chunks, pure=False)
            chunk_of = {future.key: chunk for future, chunk in zip(futures, chunks, strict=True)}
            # Held by nothing else, a result is forgotten by its worker once it is here.
            arriving = distributed.as_completed(futures, client.loop, with_results=True)
            del futures
            try:
                for future, columns in self._arrivals(client, arriving):
                    if future.cancelled():
                        raise unreachable(str(self.scheduler), "ended before the run did")
                    future.release()
                    yield chunk_of[future.key], columns
            except distributed.KilledWorker as error:
                chunk = chunk_of[error.task]
                raise input_error(
                    f"chunk {chunk}",
                    f"{error.allowed_failures + 1} Dask workers were lost while they computed it",
                    "if memory ran out, use fewer --workers; then go on with --resume",
                ) from None

    def _arrivals(self, client: Any, arriving: Any) -> Iterator[Any]:
        """Yield what arrives, and look after the workers of a scheduler meanwhile."""
        if self.scheduler is None:
            yield from arriving
            return
        patience = Patience(self.scheduler, lambda: len(client.nthreads()), self.wait)
        while not arriving.is_empty():
            if arriving.has_ready():
                yield next(arriving)
            else:
                patience.look()
                time.sleep(_POLL_EVERY)

    @contextmanager
    def _client(self, chunks: int) -> Iterator[Any]:
        import distributed

        if self.scheduler is not None:
            # What goes wrong there is told once, by the error that ends the run.
            logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
            require_scheduler(self.scheduler)
            try:
                client = distributed.Client(self.scheduler, timeout=CONNECT_WITHIN, set_as_default=False)
            except (OSError, ValueError) as error:
                raise unreachable(self.scheduler, f"cannot be reached ({error})") from None
            with client:
                yield client
            return
        options: dict[str, Any] = {
            "n_workers": min(self.workers, chunks),
            "threads_per_worker": 1,
            # Workers hold compiled programs that Dask knows nothing of; it would end them for their size.
            "memory_limit": None,
            # Any free port, so that two runs do not meet, which nobody outside this machine can reach.
            "dashboard_address": "127.0.0.1:0",
            "silence_logs": logging.CRITICAL,
            "scheduler_kwargs": {"allowed_failures": _LOSSES},
        }
        with ExitStack() as stack:
            with _interrupts_held():
                cluster = stack.enter_context(distributed.LocalCluster(**options))
            yield stack.enter_context(distributed.Client(cluster, set_as_default=False))


@dataclass(frozen=True)
class SlurmExecutor:
    """SLURM jobs, each with an equal share of the chunks, which it leaves in files that this process collects.

    A job that ends early, killed or out of time, is submitted again for what is missing of its share.

    Args:
        folder: of the jobs' files and logs, on a disk that every node sees; removed once all chunks are there.
        workers: number of jobs.
        cluster: "slurm", or "local": processes of this machine, for trying it out.
    """

    folder: Path
    workers: int
    cluster: Literal["slurm", "local"] = "slurm"

    def __post_init__(self):
        _require("submitit")
        if self.cluster == "slurm" and not shutil.which("sbatch"):
            raise input_error("--executor slurm", "found no sbatch here", "start it on a node that submits jobs")

    def compute(self, spec: str, chunks: Sequence[str]) -> Results:
        """Yield the chunks as their files appear."""
        # Jobs of an earlier attempt that still run must not meet those of this one.
        folder = self.folder / uuid.uuid4().hex[:8]
        submit = self._submitter(folder)
        count = min(self.workers, len(chunks))
        shares: list[_Share] = []
        try:
            for i in range(count):
                shares.append(_Share(list(chunks[i::count]), lambda missing: submit(spec, missing)))
            while shares:
                for share in shares:
                    yield from share.collect(folder, run_of(spec))
                shares = [share for share in shares if not share.ended]
                time.sleep(_LOOK_EVERY)
        finally:
            for share in shares:
                share.job.cancel(check=False)
                if self.cluster == "local":
                    share.job.wait()
        shutil.rmtree(self.folder, ignore_errors=True)

    def _submitter(self, folder: Path) -> Callable[[str, list[str]], Any]:
        import jax
        import submitit
        from submitit.core.utils import FailedJobError

        jobs = submitit.AutoExecutor(folder=folder, cluster=self.cluster)
        # As many cores as this process has devices: that many the program is compiled for.
        cores = len(jax.local_devices(backend="cpu"))
        jobs.update_parameters(name="vsajax", timeout_min=_JOB_MINUTES, cpus_per_task=cores)

        def submit(spec: str, chunks: list[str]) -> Any:
            try:
                return jobs.submit(run_share, spec, chunks, str(folder))
            except FailedJobError as error:
                raise input_error("sbatch", f"refused the job: {error}", "see the SBATCH_* variables") from None

        return submit


class _Share:
    """Chunks of one job after another, until all of them are there."""

    def __init__(self, chunks: list[str], submit: Callable[[list[str]], Any]):
        self.missing = chunks
        self.submit = submit
        self.job = submit(chunks)
        self.fruitless = 0
        self.ended = False

    def collect(self, folder: Path, run: str) -> Iterator[tuple[str, Columns]]:
        """Yield the chunks that have come since the last time; a job that left some out is submitted again.

        A file that is not as its job sealed it counts as left out.
        """
        # In this order: all that an ended job has left is there.
        job_ended = self.job.done()
        arrived = []
        for chunk in self.missing:
            columns = _collected(result_file(folder, chunk), run, chunk)
            if columns is not None:
                arrived.append(chunk)
                yield chunk, columns
        self.missing = [chunk for chunk in self.missing if chunk not in arrived]
        if arrived:
            self.fruitless = 0
        if job_ended and self.missing:
            self.fruitless += 1
            if self.fruitless == _TRIES:
                raise input_error(
                    self.job.paths.stderr,
                    f"{_TRIES} jobs in a row ended without a chunk; the last: {_last_line(self.job)}",
                    "read this log; then go on with --resume",
                )
            self.job = self.submit(self.missing)
        self.ended = job_ended and not self.missing


def _collected(path: Path, run: str, chunk: str) -> Columns | None:
    """Return what a job has left of a chunk, if it has come, and whole."""
    if not is_file(path):
        return None
    try:
        return columns_of(read_sealed(path, run, chunk))
    except InputError as error:
        print(f"note: {path} {error.mistakes[0].problem}; it is computed again", file=sys.stderr)
        path.unlink(missing_ok=True)
        return None


def _last_line(job: Any) -> str:
    lines = str(job.exception()).strip().splitlines()
    said = [line for line in lines if line.strip("- ") and not line.startswith(("You can check", "  - "))]
    told = [line for line in said if not line.strip().startswith("fix: ")]
    return told[-1].strip() if told else "it says nothing"


def _require(package: str) -> None:
    if util.find_spec(package) is None:
        raise input_error(package, "is not installed", "pip install 'vsajax[cluster]'")


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Keep Ctrl-C from all threads and processes that the block starts; this thread gets it after the block.

    A terminal interrupts workers too: they would die noisily before they are told to stop.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    # A thread of the block that started this process would let interrupts through to all that it starts.
    resource_tracker.ensure_running()
    # Threads inherit the mask, and processes that of their thread. Threads that are there already do not: one of
    # them may take the signal, which Python then handles in this one.
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    handler = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        signal.signal(signal.SIGINT, handler)
        if came:
            signal.raise_signal(signal.SIGINT)
