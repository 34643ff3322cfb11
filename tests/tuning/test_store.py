"""The run folder: what it says it holds, what it refuses, and what a crash leaves of it."""

from __future__ import annotations

import json
import os
from importlib import metadata

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.tuning.builders import PRIOR, small_serial
from tuning.files.errors import InputError
from tuning.files.whole import write_text
from tuning.runs import folder as store_module
from tuning.runs.folder import RunStore, open_run
from tuning.study.base import study_hash
from tuning.study.loading import parse_study

CHUNKS = ["a", "b", "c"]
PLAN = {"axes": {PRIOR: [0.1, 1.0]}, "scenarios": 2}


def opened(folder, study=None, *, command="sweep", plan=PLAN, resume=False) -> RunStore:
    return open_run(folder, command, study or small_serial(), plan, CHUNKS, resume=resume)


def refusal(folder, study=None, **options) -> str:
    """Return why a folder is refused; nothing in it may change."""
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    with pytest.raises(InputError) as caught:
        opened(folder, study, **options)
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before
    return str(caught.value)


def rows(start: float) -> dict[str, np.ndarray]:
    return {"configuration": np.arange(3), "msrep": start + np.array([0.1, 0.2, np.inf])}


def test_a_manifest_says_what_is_computed(tmp_path):
    study = small_serial("seed=5")
    store = opened(tmp_path / "deep" / "run", study)
    manifest = json.loads((tmp_path / "deep" / "run" / "manifest.json").read_text())
    assert manifest == store.manifest
    assert {key: manifest[key] for key in ("command", "plan", "seed", "chunks")} == {
        "command": "sweep",
        "plan": PLAN,
        "seed": 5,
        "chunks": CHUNKS,
    }
    assert manifest["study_hash"] == study_hash(study)
    # The study in it is whole: it can be run again from the manifest alone.
    assert parse_study(manifest["study"], "manifest") == study
    assert {"python", "jax", "jaxlib", "vsajax", "numpy"} <= manifest["versions"].keys()
    assert manifest["versions"]["jax"] == metadata.version("jax")


def test_finished_chunks_are_not_pending_and_are_joined_in_order(tmp_path):
    store = opened(tmp_path)
    assert list(store.pending()) == CHUNKS
    store.write_chunk("c", rows(2.0))
    store.write_chunk("a", rows(0.0))
    assert list(store.pending()) == ["b"]
    again = opened(tmp_path, resume=True)
    assert list(again.pending()) == ["b"]
    again.write_chunk("b", rows(1.0))
    table = pq.read_table(again.finish())
    expected = np.concatenate([rows(start)["msrep"] for start in (0.0, 1.0, 2.0)])
    np.testing.assert_array_equal(table["msrep"].to_numpy(), expected)
    assert pq.read_table(tmp_path / "results.parquet").equals(table.combine_chunks())
    del store, again
    assert sorted(os.listdir(tmp_path)) == ["chunks", "manifest.json", "results.parquet"]
    assert sorted(os.listdir(tmp_path / "chunks")) == ["a.parquet", "b.parquet", "c.parquet"]


@pytest.mark.equivalence
def test_results_are_joined_in_parts_to_the_same_table(tmp_path, monkeypatch):
    store = opened(tmp_path)
    for start, chunk in enumerate(CHUNKS):
        store.write_chunk(chunk, rows(start))
    whole = pq.read_table(store.finish())
    monkeypatch.setattr(store_module, "_ROWS_AT_ONCE", 4)
    assert pq.ParquetFile(store.finish()).num_row_groups == 2
    assert pq.read_table(tmp_path / "results.parquet").equals(whole)


@pytest.mark.structure
def test_a_million_rows_are_joined_without_holding_them(tmp_path):
    chunks = [f"{i:03d}" for i in range(50)]
    store = open_run(tmp_path, "sweep", small_serial(), PLAN, chunks, resume=False)
    columns = {f"score{i}": np.random.default_rng(i).random(20_000) for i in range(8)}
    for chunk in chunks:
        store.write_chunk(chunk, columns)
    pool, usual = pa.proxy_memory_pool(pa.default_memory_pool()), pa.default_memory_pool()
    pa.set_memory_pool(pool)
    try:
        path = store.finish()
    finally:
        pa.set_memory_pool(usual)
    assert pq.ParquetFile(path).metadata.num_rows == 1_000_000
    # All rows are 64 MB.
    assert 1e6 < pool.max_memory() < 24e6


@pytest.mark.failure
def test_a_chunk_that_a_crash_of_the_machine_cut_short_is_computed_again(tmp_path):
    store = opened(tmp_path)
    for chunk in CHUNKS:
        store.write_chunk(chunk, rows(0.0))
    path = tmp_path / "chunks" / "b.parquet"
    written = path.read_bytes()
    for length in (0, 1, 4, len(written) // 2, len(written) - 1):
        path.write_bytes(written[:length])
        assert list(store.pending()) == ["b"]
        with pytest.raises(InputError, match=r"b\.parquet: cannot be read .*\n.*--resume computes it again"):
            store.finish()
        assert sorted(os.listdir(tmp_path)) == [".lock", "chunks", "manifest.json"]
    path.write_bytes(bytes(len(written)))
    assert list(store.pending()) == ["b"]
    store.write_chunk("b", rows(0.0))
    assert path.read_bytes() == written


@pytest.mark.failure
def test_a_manifest_that_was_never_put_in_place_is_no_obstacle(tmp_path):
    (tmp_path / ".manifest.json.123.tmp").write_text('{"command": "swe')
    for resume in (False, True):
        (tmp_path / "notes.txt").write_text("")
        assert "is not empty and holds no run" in refusal(tmp_path, resume=resume)
        (tmp_path / "notes.txt").unlink()
        opened(tmp_path, resume=resume)
        assert os.listdir(tmp_path) == ["manifest.json"]
        (tmp_path / "manifest.json").rename(tmp_path / ".manifest.json.45.tmp")


def test_a_run_goes_on_with_the_manifest_that_it_has(tmp_path):
    opened(tmp_path)
    before = (tmp_path / "manifest.json").stat()
    opened(tmp_path, small_serial("name=other", "provenance={note='moved'}"), resume=True)
    after = (tmp_path / "manifest.json").stat()
    assert (before.st_ino, before.st_mtime_ns) == (after.st_ino, after.st_mtime_ns)


@pytest.mark.failure
def test_another_run_is_refused_with_or_without_resume(tmp_path):
    opened(tmp_path)
    for resume in (False, True):
        text = refusal(tmp_path, small_serial("seed=1"), resume=resume)
        assert f"{tmp_path}: holds another run: it differs in study_hash (" in text
        assert "name a new folder with -o" in text
        text = refusal(tmp_path, plan=PLAN | {"scenarios": 3}, command="tune", resume=resume)
        assert "it differs in command (sweep there) and plan (" in text
        assert "study_hash" not in text


@pytest.mark.failure
def test_the_same_run_is_refused_without_resume(tmp_path):
    opened(tmp_path)
    text = refusal(tmp_path)
    assert f"{tmp_path}: holds this run already\n    fix: go on with --resume" in text


@pytest.mark.failure
def test_a_folder_of_something_else_is_refused(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    assert "is not empty and holds no run" in refusal(tmp_path)
    assert "is not empty and holds no run" in refusal(tmp_path, resume=True)
    assert "is a file, not a run folder" in refusal(tmp_path / "thesis.tex")


@pytest.mark.failure
@pytest.mark.parametrize("text", ["", "{", "\N{REPLACEMENT CHARACTER}"])
def test_a_manifest_that_cannot_be_read_is_named(tmp_path, text):
    opened(tmp_path)
    (tmp_path / "manifest.json").write_text(text)
    assert f"{tmp_path / 'manifest.json'}: cannot be read as a manifest" in refusal(tmp_path, resume=True)


@pytest.mark.failure
def test_a_manifest_that_lacks_keys_is_refused_by_their_names(tmp_path):
    (tmp_path / "manifest.json").write_text("{}")
    assert "it lacks command, study_hash, plan, seed, study, chunks, versions" in refusal(tmp_path, resume=True)


@pytest.mark.failure
def test_a_full_disk_leaves_a_chunk_pending_and_no_scraps(tmp_path, monkeypatch):
    store = opened(tmp_path)
    store.write_chunk("a", rows(0.0))

    def refuse(*_):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", refuse)
        with pytest.raises(
            InputError, match=r"b\.parquet: cannot be written \(No space left on device\)\n.*--resume"
        ):
            store.write_chunk("b", rows(1.0))
    assert os.listdir(tmp_path / "chunks") == ["a.parquet"]
    assert list(store.pending()) == ["b", "c"]


@pytest.mark.failure
def test_a_text_that_cannot_be_written_leaves_the_old_one_and_no_scraps(tmp_path, monkeypatch):
    write_text(tmp_path / "best.toml", "old")

    def refuse(*_):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", refuse)
        with pytest.raises(InputError, match=r"best\.toml: cannot be written \(No space left on device\)"):
            write_text(tmp_path / "best.toml", "new")
    assert os.listdir(tmp_path) == ["best.toml"]
    assert (tmp_path / "best.toml").read_text() == "old"
    for place in (tmp_path / "best.toml" / "x.toml", tmp_path):
        with pytest.raises(InputError, match=r"cannot be written"):
            write_text(place, "new")
    assert os.listdir(tmp_path) == ["best.toml"]
