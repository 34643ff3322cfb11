"""Damage to a run folder: nothing that was changed is joined silently, and nothing ends with a traceback."""

from __future__ import annotations

import json
import os
import pickle
import shutil
import socket
import struct
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.tuning.builders import PRIOR, SERIAL, SMALL, TINY, edit_manifest, small_serial, tiny_tuning
from tuning.files.errors import InputError
from tuning.files.seal import SEALED, Digest
from tuning.files.tables import put
from tuning.report.gather import load_best, open_finished
from tuning.runs.executors import _collected
from tuning.runs.folder import RunStore, open_run, read_results
from tuning.runs.lock import lock_folder
from tuning.runs.manifest import read_manifest
from tuning.runs.sealed import write_sealed
from tuning.runs.workers import planner_of, result_file, spec_of
from tuning.search.blackbox import BlackBox, explore
from tuning.search.refine import Search
from tuning.study.base import hash_resolved, resolved, study_hash, to_toml
from tuning.study.inputs import hash_inputs
from tuning.study.paths import numeric_paths
from vsajax import Scores

ROOT = Path(__file__).parents[2]
CHUNKS = ["a", "b", "c"]
PLAN = {"axes": {PRIOR: [0.1, 1.0, 10.0]}, "scenarios": 2, "points_per_chunk": 1}


def rows(chunk: str) -> dict[str, np.ndarray]:
    """Return what computing a chunk gives."""
    start = CHUNKS.index(chunk)
    return {
        "configuration": np.full(3, start),
        "msrep": start + np.array([0.1, np.nan, np.inf]),
        "diverged": np.array([False, True, False]),
        "message": np.array(["", "ended", "ä"]),
    }


def run_on(folder: Path, *settings: str, resume: bool = True) -> list[str]:
    """Go on with a run to its end, and return what had to be computed."""
    store = open_run(folder, "sweep", small_serial(*settings), PLAN, CHUNKS, resume=resume)
    pending = list(store.pending())
    for chunk in pending:
        store.write_chunk(chunk, rows(chunk))
    store.finish()
    return pending


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def whole(tmp_path) -> Path:
    """A finished run."""
    assert run_on(tmp_path / "run", resume=False) == CHUNKS
    return tmp_path / "run"


@pytest.mark.failure
def test_no_changed_byte_of_chunks_or_manifest_is_joined_silently(whole, capsys):
    rng = np.random.default_rng(17)
    before = contents(whole)
    files = [whole / "manifest.json", *(whole / "chunks").iterdir()]
    counts = {"refused": 0, "computed": 0, "without effect": 0}
    for i in range(240):
        path = files[i % len(files)]
        name = str(path.relative_to(whole))
        spoilt = bytearray(before[name])
        spoilt[int(rng.integers(len(spoilt)))] ^= int(rng.integers(1, 256))
        path.write_bytes(spoilt)
        capsys.readouterr()
        refused, computed = "", []
        try:
            computed = run_on(whole)
        except InputError as error:
            refused = str(error)
        counts["refused" if refused else "computed" if computed else "without effect"] += 1
        if refused:
            assert refused.startswith(str(path))
        elif computed:
            assert computed == [path.stem]
            assert f"note: {path} " in capsys.readouterr().err
            assert path.read_bytes() == before[name]
        assert (whole / "results.parquet").read_bytes() == before["results.parquet"]
        path.write_bytes(before[name])
    assert contents(whole) == before
    assert counts["refused"] > 30
    assert counts["computed"] > 100, counts


def copy_another(path):
    shutil.copy(path.with_name("a.parquet"), path)


def edit(path):
    table = pq.read_table(path)
    scores = table["msrep"].to_numpy().copy()
    scores[0] += 1e-12
    pq.write_table(table.set_column(1, "msrep", pa.array(scores)), path)


def edit_a_text(path):
    table = pq.read_table(path)
    pq.write_table(table.set_column(3, "message", pa.array(["", "Ended", "ä"])), path)


def rewrite_without_seal(path):
    pq.write_table(pq.read_table(path).replace_schema_metadata(None), path)


def rename_a_column(path):
    table = pq.read_table(path)
    renamed = table.rename_columns(["configuration", "other", "diverged", "message"])
    pq.write_table(renamed.replace_schema_metadata(table.schema.metadata), path)


def shorten(path):
    table = pq.read_table(path)
    pq.write_table(table.slice(0, table.num_rows - 1), path)


def change_a_type(path):
    table = pq.read_table(path)
    pq.write_table(table.set_column(1, "msrep", table["msrep"].cast(pa.float32())), path)


def swap_rows(path):
    pq.write_table(pq.read_table(path).take([1, 0, 2]), path)


def take_from_another_run(path):
    other = path.parents[2] / "other"
    run_on(other, "seed=1", resume=False)
    shutil.copy(other / "chunks" / path.name, path)


def put_nonsense_in_its_seal(path):
    table = pq.read_table(path)
    pq.write_table(table.replace_schema_metadata({b"vsajax.seal": b"[]"}), path)


DAMAGED = {
    copy_another: "is a copy of a",
    edit: "does not hold what was written",
    edit_a_text: "does not hold what was written",
    rewrite_without_seal: "carries no seal",
    rename_a_column: "does not hold what was written",
    shorten: "has 2 rows, not the 3",
    change_a_type: "does not hold what was written",
    swap_rows: "does not hold what was written",
    take_from_another_run: "is of another run",
    put_nonsense_in_its_seal: "carries a broken seal",
    lambda path: path.write_bytes(b""): "cannot be read",
    lambda path: path.write_text("PAR1 or not"): "cannot be read",
}


@pytest.mark.failure
@pytest.mark.parametrize("damage", DAMAGED, ids=lambda f: f.__name__.strip("<>"))
def test_a_chunk_that_is_not_as_it_was_written_is_named_and_computed_again(whole, damage, capsys):
    before, path = contents(whole), whole / "chunks" / "b.parquet"
    damage(path)
    store = open_run(whole, "sweep", small_serial(), PLAN, CHUNKS, resume=True)
    with pytest.raises(InputError, match=r"b\.parquet: .*\n.*--resume computes it again"):
        store.finish()
    capsys.readouterr()
    assert run_on(whole) == ["b"]
    said = capsys.readouterr().err
    assert f"note: {path} {DAMAGED[damage]}" in said
    assert said.count("\n") == 1
    del store
    assert contents(whole) == before


def put_a_pipe(path):
    path.unlink()
    os.mkfifo(path)


def put_a_directory(path):
    path.unlink()
    path.mkdir()


def put_a_socket(path):
    path.unlink()
    bound = socket.socket(socket.AF_UNIX)
    here = os.getcwd()
    os.chdir(path.parent)
    bound.bind(path.name)
    os.chdir(here)
    bound.close()


def put_a_link_to(target):
    def put(path):
        path.unlink()
        path.symlink_to(target)

    return put


@pytest.mark.failure
@pytest.mark.parametrize("name", ["chunks/b.parquet", "manifest.json"])
@pytest.mark.parametrize(
    ("put", "what"),
    [
        (put_a_pipe, "is a pipe"),
        (put_a_directory, "is a directory"),
        (put_a_socket, "is a socket"),
        (put_a_link_to("/dev/zero"), "is a device"),
        (lambda path: put_a_link_to(path.name)(path), "cannot be read"),
    ],
)
def test_what_is_no_file_is_refused_without_being_opened(whole, name, put, what):
    path = whole / name
    put(path)
    with pytest.raises(InputError) as caught:
        run_on(whole)
    assert f"{path}: {what}" in str(caught.value)
    assert "fix: " in str(caught.value)


@pytest.mark.failure
def test_a_chunk_folder_that_is_none_is_refused(whole):
    shutil.rmtree(whole / "chunks")
    (whole / "chunks").write_text("")
    with pytest.raises(InputError, match=r"a\.parquet: cannot be read \(Not a directory\)"):
        run_on(whole)


EDITS = {
    "study": (
        lambda m: m["study"]["estimator"]["fit"].update(prior_scale=2.0),
        "study: has been changed: its hash",
    ),
    "hash": (lambda m: m.update(study_hash="0" * 16), "study: has been changed: its hash"),
    "both": (
        lambda m: m["study"].update(seed=4) or m.update(study_hash=hash_resolved(m["study"])),
        "breaks its seal",
    ),
    "plan": (lambda m: m["plan"].update(scenarios=3), "breaks its seal"),
    "seed": (lambda m: m.update(seed=3), "breaks its seal"),
    "versions": (lambda m: m["versions"].update(jax="0"), "breaks its seal"),
    "order": (lambda m: m["chunks"].reverse(), "breaks its seal"),
    "lost seal": (lambda m: m.pop("sealed"), "breaks its seal"),
    "lost key": (lambda m: m.pop("plan"), "it lacks plan"),
    "other key": (lambda m: m.update(plans=m.pop("plan")), "it lacks plan"),
    "new key": (lambda m: m.update(note="mine"), "note: unknown key"),
    "list": (lambda m: m.update(study=[]), "study: got [], not a object"),
    "number": (lambda m: m.update(seed=True), "seed: got True, not a whole number"),
    "text": (lambda m: m.update(chunks="abc"), "chunks: got abc, not a list"),
    "ids": (lambda m: m.update(chunks=[1, 2]), "chunks: got ids that are no strings"),
}


@pytest.mark.failure
@pytest.mark.parametrize("case", EDITS)
def test_an_edited_manifest_is_refused_by_name_whether_or_not_chunks_are_missing(whole, case):
    change, said = EDITS[case]
    path = whole / "manifest.json"
    manifest = json.loads(path.read_text())
    change(manifest)
    path.write_text(json.dumps(manifest))
    (whole / "chunks" / "b.parquet").unlink()
    before = contents(whole)
    for begin in (lambda: run_on(whole), lambda: open_finished(whole)):
        with pytest.raises(InputError) as caught:
            begin()
        assert str(path) in str(caught.value)
        assert said in str(caught.value)
        assert contents(whole) == before


@pytest.mark.failure
@pytest.mark.parametrize("text", ["[" * 100_000, "null", "3", '"a"', '{"command": NaN}', "\x00"])
def test_a_manifest_of_nonsense_is_refused(whole, text):
    (whole / "manifest.json").write_text(text)
    with pytest.raises(InputError, match=r"manifest\.json: cannot be read as a manifest"):
        run_on(whole)


def test_a_manifest_that_was_only_laid_out_anew_goes_on(whole):
    path = whole / "manifest.json"
    path.write_text(json.dumps(json.loads(path.read_text()), sort_keys=True))
    assert run_on(whole) == []


@pytest.mark.failure
def test_chunks_of_another_cut_are_refused(whole):
    with pytest.raises(InputError, match=r"chunks: lists 3 chunks, not the 4 into which this version cuts"):
        open_run(whole, "sweep", small_serial(), PLAN, [*CHUNKS, "d"], resume=True)


@pytest.mark.failure
def test_a_run_from_before_the_seals_goes_on_with_a_word_of_warning(whole, capsys):
    expected = (whole / "results.parquet").read_bytes()
    manifest = json.loads((whole / "manifest.json").read_text())
    legacy = {key: value for key, value in manifest.items() if key not in {"files", SEALED}}
    (whole / "manifest.json").write_text(json.dumps(legacy))
    for chunk in ("a", "b"):
        rewrite_without_seal(whole / "chunks" / f"{chunk}.parquet")
    (whole / "chunks" / "c.parquet").unlink()
    assert run_on(whole) == ["c"]
    assert f"note: {whole} was begun before runs were sealed" in capsys.readouterr().err
    assert (whole / "results.parquet").read_bytes() == expected
    # What was sealed since is verified; columns of another make are refused, not a traceback.
    edit(whole / "chunks" / "c.parquet")
    assert run_on(whole) == ["c"]
    rewrite_without_seal(whole / "chunks" / "b.parquet")
    rename_a_column(whole / "chunks" / "b.parquet")
    with pytest.raises(InputError, match=r"b\.parquet: has other columns than a\.parquet"):
        run_on(whole)


@pytest.mark.failure
def test_results_that_were_changed_are_not_reported_on(whole):
    assert read_results(whole).num_rows == 9
    edit(whole / "results.parquet")
    with pytest.raises(InputError, match=r"results\.parquet: carries no seal"):
        read_results(whole)
    assert run_on(whole) == []
    shutil.copy(whole / "chunks" / "a.parquet", whole / "results.parquet")
    with pytest.raises(InputError, match=r"results\.parquet: is a copy of a"):
        read_results(whole)


def test_a_digest_does_not_depend_on_cuts_and_on_nothing_that_parquet_chooses(tmp_path):
    table = pa.table(rows("b"))
    cut, one = Digest(), Digest()
    for part in (table.slice(0, 1), table.slice(1)):
        cut.update(part)
    pq.write_table(table, tmp_path / "plain.parquet", compression="none", use_dictionary=False)
    one.update(pq.read_table(tmp_path / "plain.parquet"))
    assert cut.hexdigest() == one.hexdigest()
    assert cut.rows == one.rows == 3


def recorded(path: Path) -> tuple[str, ...]:
    return (f"excitation.motor={{ type = 'file', path = '{path}' }}",)


def write_torque(path: Path, torque: float) -> None:
    time = np.linspace(0.0, 0.3, 50)
    lines = [f"{t!r},{torque * np.sin(20.0 * t)!r}" for t in time.tolist()]
    path.write_text("\n".join(["time,motor_torque", *lines]) + "\n")


@pytest.mark.failure
def test_a_file_that_a_study_names_belongs_to_the_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    drive = Path("drive.csv")
    write_torque(drive, 1.0)
    settings, run = recorded(drive), tmp_path / "run"
    known = study_hash(small_serial(*settings))
    run_on(run, *settings, resume=False)
    assert json.loads((run / "manifest.json").read_text())["files"].keys() == {"drive.csv"}
    assert run_on(run, *settings) == []
    kept = drive.read_bytes()
    write_torque(drive, 1.1)
    # The hash of a study is that of its text.
    assert study_hash(small_serial(*settings)) == known
    for begin in (lambda: run_on(run, *settings), lambda: open_finished(run)):
        with pytest.raises(InputError, match=r"^drive\.csv: has changed since the run in .* was begun\n"):
            begin()
    # A chunk of the other torque would not pass for one of this run either.
    run_on(tmp_path / "other", *settings, resume=False)
    shutil.copy(tmp_path / "other" / "chunks" / "b.parquet", run / "chunks" / "b.parquet")
    drive.write_bytes(kept)
    assert run_on(run, *settings) == ["b"]
    drive.unlink()
    with pytest.raises(InputError, match=r"drive\.csv: cannot be read \(No such file"):
        run_on(run, *settings)
    os.mkfifo(drive)
    with pytest.raises(InputError, match=r"drive\.csv: is no regular file"):
        run_on(run, *settings)


def test_files_of_every_structure_belong_to_the_run(tmp_path):
    for name in ("a.csv", "b.csv"):
        write_torque(tmp_path / name, 1.0)
    options = ", ".join(
        f"{name} = {{ 'excitation.motor' = {{ type = 'file', path = '{tmp_path / name}.csv' }} }}" for name in "ab"
    )
    study = tiny_tuning(f"tune.choices.drive={{ {options} }}")
    assert hash_inputs(study).keys() == {str(tmp_path / "a.csv"), str(tmp_path / "b.csv")}
    assert hash_inputs(small_serial()) == {}


HOLDER = """
import sys, time
from pathlib import Path
from tuning.runs.lock import lock_folder
held = lock_folder(Path(sys.argv[1]))
print("held", flush=True)
time.sleep(60)
"""


@pytest.fixture
def holder(whole):
    """Another process that is at work on the run."""
    words = [sys.executable, "-c", HOLDER, str(whole)]
    process = subprocess.Popen(
        words, stdout=subprocess.PIPE, text=True, env=os.environ | {"PYTHONPATH": str(ROOT)}
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    yield process
    process.kill()
    process.communicate()


@pytest.mark.failure
def test_a_second_process_is_refused_and_a_lock_falls_with_its_process(whole, holder):
    before = contents(whole)
    with pytest.raises(InputError) as caught:
        run_on(whole)
    assert f"{whole}: is in use by process {holder.pid} on {socket.gethostname()}" in str(caught.value)
    assert contents(whole) == before
    holder.kill()
    holder.wait()
    # The file is still there; it locks nothing.
    assert (whole / ".lock").exists()
    assert run_on(whole) == []
    assert not (whole / ".lock").exists()


def test_a_process_has_its_own_lock_already_and_lets_go_of_it_at_the_end(tmp_path):
    first, second = lock_folder(tmp_path), lock_folder(tmp_path)
    assert first is second
    del first
    assert (tmp_path / ".lock").exists()
    del second
    assert not (tmp_path / ".lock").exists()
    # A folder that was removed and made again is another one.
    held = lock_folder(tmp_path)
    (tmp_path / ".lock").unlink()
    assert lock_folder(tmp_path) is not held


@pytest.mark.failure
@pytest.mark.parametrize("put", [Path.mkdir, lambda path: path.symlink_to("elsewhere")])
def test_a_lock_that_cannot_be_taken_is_named(whole, put):
    put(whole / ".lock")
    with pytest.raises(InputError, match=r"cannot be locked: \.lock cannot be written"):
        run_on(whole)


@pytest.fixture
def bowl(monkeypatch) -> None:
    """Score points by a closed form, and judge nothing."""
    from tests.tuning.test_blackbox import BLANK

    def score(search: Search, points: np.ndarray) -> Scores:
        ones = np.ones((1, search.study.scenarios.train))
        blank = {name: ones for name in Scores._fields}
        objective = np.log(points[:, 0] / 2.0) ** 2 + 10.0 * (points[:, 1] - 0.7) ** 2
        times = points[:, 0, None] * ones
        return Scores(**(blank | {"msrep": objective[:, None] * ones, "convergence_time": times}))

    monkeypatch.setattr(Search, "score", score)
    monkeypatch.setattr(Search, "judge", lambda *_: BLANK)


def searched(folder: Path, *, resume: bool = True):
    explored = explore(BlackBox(tiny_tuning(), "tpe", batch=4), folder, trials=12, resume=resume, quiet=True)
    return [(t.number, tuple(t.values.values()), t.objective) for t in explored.trials]


@pytest.mark.failure
@pytest.mark.usefixtures("bowl")
def test_no_changed_byte_of_a_journal_is_believed(tmp_path, capsys):
    folder = tmp_path / "run"
    expected = searched(folder, resume=False)
    journal = folder / "optuna.log"
    written = journal.read_bytes()
    rng, said = np.random.default_rng(5), 0
    for _ in range(16):
        spoilt = bytearray(written)
        spoilt[int(rng.integers(len(spoilt)))] ^= int(rng.integers(1, 256))
        journal.write_bytes(spoilt)
        capsys.readouterr()
        assert searched(folder) == expected
        said += f"note: {journal} " in capsys.readouterr().err
    # The rest fell into the last mark: that batch is asked for again, as if the process had been killed in it.
    assert said > 10


@pytest.mark.failure
@pytest.mark.usefixtures("bowl")
def test_a_journal_that_is_anothers_or_none_is_not_gone_on_with(tmp_path, capsys):
    folder, other = tmp_path / "run", tmp_path / "other"
    expected = searched(folder, resume=False)
    explore(BlackBox(tiny_tuning("seed=1"), "tpe", batch=4), other, trials=12, quiet=True)
    journal = folder / "optuna.log"
    shutil.copy(other / "optuna.log", journal)
    capsys.readouterr()
    assert searched(folder) == expected
    assert "holds the trials of another run" in capsys.readouterr().err
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join(lines[:10] + lines[11:]))
    assert searched(folder) == expected
    assert "is not as it was written before batch 1 ends" in capsys.readouterr().err
    for replace, what in ((put_a_pipe, "is a pipe"), (put_a_directory, "is a directory")):
        shutil.copytree(folder, tmp_path / what)
        replace(tmp_path / what / "optuna.log")
        with pytest.raises(InputError, match=rf"optuna\.log: {what}"):
            searched(tmp_path / what)


@pytest.mark.failure
@pytest.mark.usefixtures("bowl")
def test_a_search_from_before_the_seals_goes_on_and_a_broken_one_is_refused_by_name(tmp_path):
    folder = tmp_path / "run"
    expected = searched(folder, resume=False)
    manifest = json.loads((folder / "manifest.json").read_text())
    legacy = {key: value for key, value in manifest.items() if key not in {"files", SEALED}}
    (folder / "manifest.json").write_text(json.dumps(legacy))
    lines = []
    for line in (folder / "optuna.log").read_text().splitlines():
        entry = json.loads(line)
        if "whole_batches" in entry.get("user_attr", {}):
            entry["user_attr"]["whole_batches"] = entry["user_attr"]["whole_batches"]["batches"]
        lines.append(json.dumps(entry, separators=(",", ":")) + "\n")
    (folder / "optuna.log").write_text("".join(lines))
    assert searched(folder) == expected
    refused = 0
    for i in range(0, len(lines), 5):
        for change in (lambda e: e | {"op_code": 77}, lambda e: e | {"study_id": 3, "trial_id": 99}, lambda _: {}):
            changed = json.dumps(change(json.loads(lines[i]))) + "\n"
            (folder / "optuna.log").write_text("".join([*lines[:i], changed, *lines[i + 1 :]]))
            # Without a seal only what Optuna stumbles over is found; that is no traceback.
            try:
                searched(folder)
            except InputError as error:
                refused += str(folder / "optuna.log") in str(error)
    assert refused > 10


@pytest.mark.failure
@pytest.mark.usefixtures("bowl")
def test_a_best_that_was_changed_is_not_reported_on(tmp_path):
    folder = tmp_path / "run"
    searched(folder, resume=False)
    path = folder / "best.toml"
    written = path.read_text()
    values = numeric_paths(load_best(open_finished(folder)))
    for name in (PRIOR, "estimator.fit.law.forgetting", "joint.link.inertia"):
        tables = tomllib.loads(written)
        put(tables, name.split("."), values[name] * 1.01)
        path.write_text(to_toml(tables))
        with pytest.raises(InputError, match=r"best\.toml: is not what this search has found"):
            load_best(open_finished(folder))
    path.write_text(written.replace('tuned = ["', 'tuned = ["x'))
    with pytest.raises(InputError, match=r"best\.toml: is not what this search has found"):
        load_best(open_finished(folder))
    assert searched(folder)
    assert load_best(open_finished(folder)).provenance["command"] == "tune"


@pytest.mark.failure
def test_what_a_job_left_half_written_is_computed_again(tmp_path, capsys):
    path = result_file(tmp_path, "b")
    assert _collected(path, "run", "b") is None
    write_sealed(path, rows("b"), "run", "b")
    found = _collected(path, "run", "b")
    assert found is not None
    assert {name: values.tobytes() for name, values in found.items() if values.dtype != object} == {
        name: values.tobytes() for name, values in rows("b").items() if values.dtype.kind != "U"
    }
    for run, chunk in (("other", "b"), ("run", "c")):
        write_sealed(path, rows("b"), "run", "b")
        assert _collected(path, run, chunk) is None
        assert f"note: {path} is " in capsys.readouterr().err
        assert not path.exists()


@pytest.mark.failure
def test_a_worker_that_sees_another_file_says_so_to_the_process_that_asked(tmp_path):
    drive = tmp_path / "drive.csv"
    write_torque(drive, 1.0)
    store = open_run(tmp_path / "run", "sweep", small_serial(*recorded(drive)), PLAN, CHUNKS, resume=False)
    spec = spec_of(store.manifest)
    assert planner_of(spec).chunks
    planner_of.cache_clear()
    write_torque(drive, 2.0)
    with pytest.raises(InputError) as caught:
        planner_of(spec)
    told = pickle.loads(pickle.dumps(caught.value))
    assert told.mistakes == caught.value.mistakes
    assert f"{drive}: has changed since the run" in str(told)


def words_of(run: Path) -> list[str]:
    words = ["sweep", SERIAL, "-o", run, "--scenarios", "2", "--grid", f"{PRIOR}=0.1,1.0,10.0"]
    return [str(word) for word in [*words, *(w for setting in (*SMALL, *TINY) for w in ("--set", setting))]]


ONE_A_CHUNK = "from tuning.scoring import sweep; from tuning.cli import main; sweep._STEPS_PER_CHUNK = 1.0; main()"


def command(*words: object, code: str = ONE_A_CHUNK) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code, *map(str, words)],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )


@pytest.mark.slow(
    twin=(
        "test_a_chunk_that_is_not_as_it_was_written_is_named_and_computed_again",
        "test_an_edited_manifest_is_refused_by_name_whether_or_not_chunks_are_missing",
    )
)
@pytest.mark.cli
@pytest.mark.failure
def test_damage_of_every_kind_from_the_shell(tmp_path):
    run = tmp_path / "run"
    assert command(*words_of(run)).returncode == 0
    expected = {name: held for name, held in contents(run).items() if name.endswith(".parquet")}
    path = run / "chunks" / "000001.parquet"

    def flip():
        written, whole = path.read_bytes(), pq.read_table(path)
        score = struct.pack("<d", whole["msrep"][0].as_py())
        # Statistics hold it too, of which nothing is read.
        for part in range(1, written.count(score) + 1):
            at = len(score.join(written.split(score)[:part]))
            path.write_bytes(written[:at] + bytes([written[at] ^ 1]) + written[at + 1 :])
            if pq.read_table(path)["msrep"] != whole["msrep"]:
                return
        raise AssertionError("no byte of a score was found")

    def copy():
        shutil.copy(path.with_name("000000.parquet"), path)

    for damage in (flip, copy, lambda: shorten(path)):
        damage()
        ended = command(*words_of(run), "--resume", "--quiet")
        assert ended.returncode == 0
        assert "000001.parquet" in ended.stderr
        assert "it is computed again" in ended.stderr
        assert {name: held for name, held in contents(run).items() if name.endswith(".parquet")} == expected
    for spoil, said in (
        (lambda: put_a_pipe(path), "is a pipe, not a file"),
        (lambda: edit_study(run), "study: has been changed"),
    ):
        spoil()
        ended = command(*words_of(run), "--resume")
        assert (ended.returncode, ended.stdout) == (2, "")
        assert said in ended.stderr
        assert "Traceback" not in ended.stderr
        path.unlink(missing_ok=True)


def edit_study(run: Path) -> None:
    path = run / "manifest.json"
    path.write_text(path.read_text().replace('"prior_scale": ', '"prior_scale": 3'))


SLOW_SEARCH = """
import time
from tuning.search.blackbox import BlackBox
from tuning.cli import main

told = BlackBox.evaluate

def evaluate(self, asked):
    print("asked", flush=True)
    time.sleep(2.0)
    return told(self, asked)

BlackBox.evaluate = evaluate
main()
"""


@pytest.mark.slow(twin="test_a_second_process_is_refused_and_a_lock_falls_with_its_process")
@pytest.mark.cli
@pytest.mark.failure
def test_a_second_search_on_one_folder_is_refused_and_the_first_ends_as_alone(tmp_path):
    study = tmp_path / "study.toml"
    study.write_text(to_toml(resolved(tiny_tuning())))
    words = ["tune", study, "--method", "tpe", "--trials", "8", "--batch", "4", "--quiet", "-o"]
    assert command(*words, tmp_path / "alone").returncode == 0
    first = subprocess.Popen(
        [sys.executable, "-c", SLOW_SEARCH, *map(str, words), str(tmp_path / "run")],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        text=True,
    )
    with first:
        assert first.stdout is not None
        assert first.stdout.readline() == "asked\n"
        second = command(*words, tmp_path / "run", "--resume")
        assert first.poll() is None
        assert second.returncode == 2
        assert f"is in use by process {first.pid} on" in second.stderr
        assert first.wait(120) == 0
    alone, shared = (
        pq.read_table(tmp_path / name / "results.parquet").drop_columns("seconds") for name in ("alone", "run")
    )
    assert alone.equals(shared)


@pytest.mark.structure
def test_sealing_costs_less_than_writing(tmp_path):
    columns = {f"score{i}": np.random.default_rng(i).random(200_000) for i in range(12)}
    store = RunStore(tmp_path, {**read_manifest_of(tmp_path), "chunks": ["a"]})
    begin = time.perf_counter()
    store.write_chunk("a", columns)
    written = time.perf_counter() - begin
    begin = time.perf_counter()
    digest = Digest()
    digest.update(pa.table(columns))
    digest.hexdigest()
    assert time.perf_counter() - begin < written


def read_manifest_of(folder: Path):
    open_run(folder, "sweep", small_serial(), PLAN, CHUNKS, resume=False)
    edit_manifest(folder, lambda manifest: None)
    return read_manifest(folder / "manifest.json")
