"""The same chunks wherever they are computed, and whatever happens to those who compute them."""

from __future__ import annotations

import json
import os
import signal
import socketserver
import threading
import time
from collections.abc import Callable
from contextlib import closing
from importlib import import_module, util
from pathlib import Path
from types import SimpleNamespace

import click
import distributed
import psutil
import pytest

from tests.tuning.builders import NOISE, PRIOR, SERIAL, SMALL, TINY, tiny_serial
from tuning.cli.executors import executor_for
from tuning.files.errors import InputError
from tuning.runs import executors, scheduler
from tuning.runs import workers as work
from tuning.runs.executors import DaskExecutor, Executor, Inline, SlurmExecutor, complete
from tuning.runs.folder import RunStore
from tuning.runs.workers import planner_of, run_chunk, run_share, spec_of
from tuning.scoring import sweep
from tuning.scoring.sweep import GridSweep

POINTS = 16
AXES = {PRIOR: [0.1 * (i + 1) for i in range(POINTS)], NOISE: [0.01, 0.03]}


@pytest.fixture
def planned(monkeypatch, request) -> GridSweep:
    """A sweep of one point a chunk; in slow tests, each takes a worker about a tenth of a second."""
    monkeypatch.setattr(sweep, "_STEPS_PER_CHUNK", 1.0)
    slow = request.node.get_closest_marker("slow") is not None
    planned = GridSweep(tiny_serial(f"clock.duration={4.0 if slow else 0.2}"), AXES, 256 if slow else 2)
    assert len(planned.chunks) == POINTS
    return planned


@pytest.fixture
def straight(planned, tmp_path) -> dict[str, bytes]:
    """What this process computes by itself, by file."""
    store = planned.open(tmp_path / "straight", resume=False)
    complete(store, Inline(), "straight")
    return held_in(store.folder)


def held_in(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.rglob("*.parquet")}


class HookedStore(RunStore):
    """A store that does something once it holds its first chunk."""

    def write_chunk(self, chunk, columns):
        super().write_chunk(chunk, columns)
        if self.manifest["hooks"]:
            self.manifest["hooks"].pop()()


def hooked(planned: GridSweep, folder: Path, hook: Callable[[], None]) -> HookedStore:
    store = planned.open(folder, resume=False)
    return HookedStore(folder, {**store.manifest, "hooks": [hook]})


def workers() -> list[psutil.Process]:
    """Return the processes that compute for this one."""
    of_workers = ("spawn_main", "submitit.core._submit")
    offspring = psutil.Process().children(recursive=True)
    return [process for process in offspring if any(name in " ".join(process.cmdline()) for name in of_workers)]


def kill_workers() -> None:
    found = workers()
    assert found
    for process in found:
        process.kill()


@pytest.mark.equivalence
@pytest.mark.parametrize("kind", ["dask", pytest.param("submitit", marks=pytest.mark.slow)])
def test_workers_give_the_bytes_of_a_run_in_one_process(planned, straight, tmp_path, kind):
    run = tmp_path / kind
    executor = DaskExecutor(2) if kind == "dask" else SlurmExecutor(run / "jobs", 2, "local")
    store = planned.open(run, resume=False)
    assert complete(store, executor, kind) == run / "results.parquet"
    assert held_in(run) == straight
    del store
    assert sorted(path.name for path in run.iterdir()) == ["chunks", "manifest.json", "results.parquet"]
    assert workers() == []


class Job:
    """A job as submitit's, of this process: done as soon as it is submitted, and after some chunks."""

    def __init__(self, spec: str, chunks: list[str], folder: Path, most: int):
        self.paths = SimpleNamespace(stderr=folder / "job.err")
        self.cancelled = False
        run_share(spec, chunks[:most], str(folder))

    def done(self) -> bool:
        return True

    def cancel(self, *, check: bool) -> None:
        assert not check
        self.cancelled = True

    def wait(self) -> None:
        assert self.cancelled

    def exception(self) -> str:
        return "MemoryError: no room"


@pytest.fixture
def jobs(monkeypatch) -> Callable[[int], list[Job]]:
    """Return what puts jobs of this process, which end after so many chunks, in the place of SLURM's."""
    monkeypatch.setattr(work.machine, "start_jax", lambda: None)

    def ending_after(most: int) -> list[Job]:
        submitted: list[Job] = []

        def submitter(_self: SlurmExecutor, folder: Path):
            folder.mkdir(parents=True)
            return lambda spec, chunks: submitted.append(Job(spec, chunks, folder, most)) or submitted[-1]

        monkeypatch.setattr(SlurmExecutor, "_submitter", submitter)
        return submitted

    return ending_after


@pytest.mark.equivalence
def test_jobs_that_end_early_are_submitted_again_for_what_is_missing(planned, straight, tmp_path, jobs):
    submitted, run = jobs(5), tmp_path / "run"
    complete(planned.open(run, resume=False), SlurmExecutor(run / "jobs", 2, "local"), "jobs")
    assert held_in(run) == straight
    # Shares of eight chunks each: five, then the other three.
    assert len(submitted) == 4
    assert not (run / "jobs").exists()


@pytest.mark.failure
def test_jobs_without_a_chunk_are_given_up_after_three(planned, tmp_path, jobs):
    submitted, run = jobs(0), tmp_path / "run"
    store = planned.open(run, resume=False)
    with pytest.raises(InputError, match="3 jobs in a row ended without a chunk; the last: MemoryError: no room"):
        complete(store, SlurmExecutor(run / "jobs", 1, "local"), "jobs")
    assert len(submitted) == 3
    assert submitted[-1].cancelled
    assert not (run / "results.parquet").exists()


@pytest.mark.equivalence
@pytest.mark.slow(twin="test_jobs_that_end_early_are_submitted_again_for_what_is_missing")
@pytest.mark.parametrize("kind", ["dask", "submitit"])
def test_workers_that_are_killed_cost_nothing_but_time(planned, straight, tmp_path, kind):
    run = tmp_path / kind
    executor = DaskExecutor(2) if kind == "dask" else SlurmExecutor(run / "jobs", 2, "local")
    store = hooked(planned, run, kill_workers)
    complete(store, executor, kind)
    assert store.manifest["hooks"] == []
    assert held_in(run) == straight
    assert workers() == []


@pytest.mark.slow(twin="test_a_scheduler_without_workers_is_waited_for_aloud_and_given_up_as_asked")
@pytest.mark.equivalence
def test_a_scheduler_that_runs_already_is_used_and_left_running(planned, straight, tmp_path):
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address="127.0.0.1:0") as cluster:
        executor = DaskExecutor(scheduler=cluster.scheduler_address)
        complete(planned.open(tmp_path / "run", resume=False), executor, "dask")
        assert held_in(tmp_path / "run") == straight
        assert len(workers()) == 1


@pytest.mark.failure
@pytest.mark.slow(
    twin=(
        "test_jobs_without_a_chunk_are_given_up_after_three",
        "tests/tuning/test_sweep.py::test_a_run_that_was_cut_off_goes_on_to_the_same_bytes_and_computes_only_what_is_missing",
    )
)
def test_a_chunk_that_ends_every_worker_ends_the_run_which_can_be_resumed(
    planned, straight, tmp_path, monkeypatch
):
    monkeypatch.setattr(executors, "_LOSSES", 0)
    run = tmp_path / "run"
    with pytest.raises(InputError, match=r"chunk 0000\d\d: 1 Dask workers were lost.*\n.*--resume"):
        complete(hooked(planned, run, kill_workers), DaskExecutor(2), "dask")
    assert workers() == []
    assert not (run / "results.parquet").exists()
    complete(planned.open(run, resume=True), Inline(), "inline")
    assert held_in(run) == straight


@pytest.mark.failure
@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nowhere", "", "carrier://pigeon:1"])
def test_a_scheduler_that_is_not_there_is_named(planned, tmp_path, monkeypatch, address):
    monkeypatch.setattr(scheduler, "CONNECT_WITHIN", 0.5)
    with pytest.raises(InputError, match=rf"scheduler {address}: cannot be reached \(.+\)\n.*--resume"):
        complete(planned.open(tmp_path / "run", resume=False), DaskExecutor(scheduler=address), "dask")


ANSWERS = {
    "nothing": None,
    "a web server's": b"HTTP/1.1 400 Bad Request\r\n\r\n",
    "another protocol's": b"SSH-2.0-OpenSSH_9.6\r\n",
    "zeros": bytes(4096),
    "ones": 512 * b"\1\0\0\0\0\0\0\0",
}
"""What a port may say to a client of Dask."""


@pytest.fixture
def listening():
    """A port that says something to whoever comes and keeps the connection open."""
    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), socketserver.BaseRequestHandler) as server:
        server.daemon_threads = True
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield server
        server.shutdown()


@pytest.mark.failure
@pytest.mark.parametrize("answer", ANSWERS)
def test_a_port_of_something_else_is_refused_in_time(planned, tmp_path, monkeypatch, listening, answer):
    said = ANSWERS[answer]
    ended = threading.Event()

    class Handler(socketserver.BaseRequestHandler):
        def handle(self):
            if said is not None:
                self.request.sendall(said)
            ended.wait(20.0)

    listening.RequestHandlerClass = Handler
    monkeypatch.setattr(scheduler, "CONNECT_WITHIN", 0.5)
    address = f"tcp://127.0.0.1:{listening.server_address[1]}"
    began = time.monotonic()
    with pytest.raises(InputError, match=r"does not answer as a Dask scheduler does") as refused:
        complete(planned.open(tmp_path / "run", resume=False), DaskExecutor(scheduler=address), "dask")
    ended.set()
    assert time.monotonic() - began < 10.0
    assert f"scheduler {address}: " in str(refused.value)
    assert "`dask scheduler` prints" in str(refused.value)


@pytest.mark.failure
def test_a_scheduler_without_workers_is_waited_for_aloud_and_given_up_as_asked(
    planned, straight, tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(scheduler, "TELL_EVERY", 0.4)
    monkeypatch.setattr(scheduler, "_LOOK_EVERY", 0.1)
    with distributed.LocalCluster(
        n_workers=0, threads_per_worker=1, processes=False, dashboard_address="127.0.0.1:0", protocol="tcp"
    ) as cluster:
        executor = DaskExecutor(scheduler=cluster.scheduler_address, wait=1.5)
        with pytest.raises(InputError, match=r"no workers within 1.5 s \(--wait\)\n.*--resume"):
            complete(planned.open(tmp_path / "run", resume=False), executor, "dask")
        told = capsys.readouterr().err.splitlines()
        assert 2 <= len(told) <= 3
        for line in told:
            assert f"scheduler {cluster.scheduler_address}: no workers yet, for " in line
            assert f"giving up after 1.5 s; start some: dask worker {cluster.scheduler_address}" in line
    assert not (tmp_path / "run" / "results.parquet").exists()


def test_patience_counts_from_the_last_worker(monkeypatch):
    now, counts, told = [0.0], [0], []
    monkeypatch.setattr(scheduler.time, "monotonic", lambda: now[0])

    def workers() -> int:
        if counts[0] < 0:
            raise OSError
        return counts[0]

    patience = scheduler.Patience("tcp://a:1", workers, 60.0, told.append)

    def pass_time(seconds: float, count: int) -> None:
        counts[0] = count
        for _ in range(round(8 * seconds)):
            now[0] += 0.125
            patience.look()

    pass_time(35.0, 0)
    assert [line.split(", for ")[1].split(" s")[0] for line in told] == ["10", "20", "30"]
    pass_time(100.0, 2)
    pass_time(100.0, -1)  # not known: the client finds out by itself
    assert len(told) == 3
    pass_time(5.0, 2)
    pass_time(59.0, 0)
    assert len(told) == 8
    with pytest.raises(InputError, match="no workers within 60 s"):
        pass_time(2.0, 0)


@pytest.mark.slow(twin="test_jobs_without_a_chunk_are_given_up_after_three")
@pytest.mark.failure
def test_jobs_that_end_without_a_chunk_are_given_up_and_their_log_is_named(tmp_path):
    spec = json.dumps(
        {
            "run": "0",
            "files": {},
            "command": "nothing",
            "study": {},
            "plan": {},
            "xla_flags": os.environ["XLA_FLAGS"],
        }
    )
    with pytest.raises(InputError) as caught:
        list(SlurmExecutor(tmp_path / "jobs", 1, "local").compute(spec, ["a", "b"]))
    (mistake,) = caught.value.mistakes
    # The problem, not the way out, which is the last line.
    last = "InputError: manifest.json: study: is not a study of a simulated joint, nor any file of the lab"
    assert mistake.problem.startswith("3 jobs in a row ended without a chunk; the last: ")
    assert last in mistake.problem
    assert last in Path(mistake.place).read_text()


@pytest.mark.slow(twin="test_jobs_without_a_chunk_are_given_up_after_three")
def test_closing_an_executor_stops_its_workers(planned, tmp_path):
    store = planned.open(tmp_path / "run", resume=False)
    for executor in (DaskExecutor(2), SlurmExecutor(tmp_path / "jobs", 2, "local")):
        with closing(executor.compute(spec_of(store.manifest), planned.chunks)) as results:
            next(results)
            assert workers()
        assert workers() == []


def test_an_interrupt_while_workers_start_is_neither_lost_nor_theirs():
    masks = []
    # A shell starts what runs in the background with the signal ignored.
    inherited = signal.signal(signal.SIGINT, signal.default_int_handler)

    def start():
        with executors._interrupts_held():
            signal.raise_signal(signal.SIGINT)
            masks.append(signal.pthread_sigmask(signal.SIG_BLOCK, []))

    try:
        with pytest.raises(KeyboardInterrupt):
            start()
        assert signal.SIGINT in masks[0]
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
        assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])
    finally:
        signal.signal(signal.SIGINT, inherited)


class Refusing:
    """Computes nothing."""

    def compute(self, spec, chunks):
        raise AssertionError(f"was asked for {chunks} of {spec}")


def test_a_finished_run_asks_no_executor(planned, straight, tmp_path):
    store = planned.open(tmp_path / "straight", resume=True)
    (store.folder / "results.parquet").unlink()
    executor: Executor = Refusing()
    complete(store, executor, "again")
    assert held_in(store.folder) == straight


@pytest.mark.contract
@pytest.mark.parametrize("command", sorted(work._PLANNERS))
def test_what_a_command_computes_can_be_found_by_its_name(command):
    module, _, name = work._PLANNERS[command].partition(":")
    planner = getattr(import_module(module), name)
    assert {"from_plan", "run_chunk", "chunks"} <= set(dir(planner))


def test_another_process_finds_the_same_chunks_with_another_constant(planned, tmp_path, monkeypatch):
    manifest = json.loads((planned.open(tmp_path, resume=False).folder / "manifest.json").read_text())
    monkeypatch.setattr(sweep, "_STEPS_PER_CHUNK", 1.0e8)
    spec = spec_of(manifest)
    found = planner_of(spec)
    assert found.chunks == planned.chunks == manifest["chunks"]
    assert (found.study, found.plan) == (planned.study, planned.plan)
    # A process plans, and compiles, once.
    assert planner_of(spec) is found


def test_a_worker_computes_under_the_flags_of_the_run(planned, tmp_path, monkeypatch):
    flags = os.environ["XLA_FLAGS"]
    spec = spec_of(planned.open(tmp_path, resume=False).manifest)
    started = []
    monkeypatch.setattr(work.machine, "start_jax", lambda: started.append(os.environ["XLA_FLAGS"]))
    monkeypatch.setenv("XLA_FLAGS", "--others")
    columns = run_chunk(spec, planned.chunks[1])
    assert started == [flags]
    assert set(columns[PRIOR]) == {0.2}


def test_a_share_is_taken_up_where_it_was_left(planned, tmp_path, monkeypatch):
    spec = spec_of(planned.open(tmp_path / "run", resume=False).manifest)
    asked = []
    monkeypatch.setattr(work, "run_chunk", lambda _, chunk: asked.append(chunk) or {"x": [1.0]})
    run_share(spec, ["000001"], str(tmp_path / "share"))
    run_share(spec, planned.chunks[:3], str(tmp_path / "share"))
    assert asked == ["000001", "000000", "000002"]


def test_the_options_choose_the_executor(tmp_path, monkeypatch):
    monkeypatch.setattr(executors.shutil, "which", lambda _: "/usr/bin/sbatch")
    assert executor_for(None, None, None, tmp_path) == Inline()
    assert executor_for("inline", None, None, tmp_path) == Inline()
    assert executor_for(None, 3, None, tmp_path) == executor_for("dask", 3, None, tmp_path) == DaskExecutor(3)
    assert executor_for("dask", None, None, tmp_path).workers >= 1
    remote = executor_for(None, None, "tcp://a:1", tmp_path, 5.0)
    assert (remote.scheduler, remote.wait) == ("tcp://a:1", 5.0)
    assert executor_for("slurm", 4, None, tmp_path) == SlurmExecutor(tmp_path / "jobs", 4)


@pytest.mark.failure
@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("inline", 2, None), "--executor inline has no --workers"),
        (("inline", None, "tcp://a:1"), "--scheduler brings its own workers: it does not go with inline"),
        (("slurm", 2, "tcp://a:1"), "it does not go with --workers"),
        ((None, 2, "tcp://a:1"), "it does not go with --workers"),
        (("slurm", None, None), "--executor slurm needs --workers"),
        ((None, 2, None, 5.0), "--wait is a finite time, and needs --scheduler"),
        ((None, None, "tcp://a:1", float("inf")), "--wait is a finite time"),
    ],
)
def test_options_that_contradict_one_another_are_refused(tmp_path, options, said):
    with pytest.raises(click.UsageError, match=said):
        executor_for(*options[:3], tmp_path, *options[3:])


@pytest.mark.cli
@pytest.mark.failure
def test_what_is_missing_for_an_executor_is_named_before_anything_is_written(vsajax, tmp_path, monkeypatch):
    words = ("sweep", SERIAL, "-o", tmp_path / "run", "--grid", f"{PRIOR}=1,2", *sets())
    monkeypatch.setattr(executors.shutil, "which", lambda _: None)
    ended = vsajax(*words, "--executor", "slurm", "--workers", 2)
    assert (ended.code, ended.out) == (2, "")
    assert "found no sbatch here" in ended.err
    monkeypatch.setattr(util, "find_spec", lambda _: None)
    for options, package in (
        (("--workers", 2), "distributed"),
        (("--executor", "slurm", "--workers", 2), "submitit"),
    ):
        ended = vsajax(*words, *options)
        assert (ended.code, ended.out) == (2, "")
        assert f"{package}: is not installed\n    fix: pip install 'vsajax[cluster]'" in ended.err
    assert list(tmp_path.iterdir()) == []


def sets() -> list[str]:
    return [word for setting in (*SMALL, *TINY) for word in ("--set", setting)]
