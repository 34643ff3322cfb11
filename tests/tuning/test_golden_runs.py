"""Run folders from before the lab was rebuilt: they go on, are reported on, and what they found is used as ever.

`tests/golden/lab` holds studies, the folders of their runs and what the commands printed for machines. All of it
was made by commit 808ed36, in that folder, by the commands below; pictures are left out. Those of kinds that
estimate were made again when their answers came to their second edition; of the first, `earlier` keeps two.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Collection, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tuning.study.loading import load_config
from tuning.study.paths import numeric_paths

LAB = Path(__file__).parents[1] / "golden" / "lab"
PRINTED: dict[str, dict[str, Any]] = json.loads((LAB / "printed.json").read_text(encoding="utf-8"))
SERIAL, LAWS, RIGID, DAMPING, PAIR, ARM, LOG = (
    f"studies/{name}.toml" for name in ("serial", "laws", "rigid", "damping", "antagonistic", "arm", "log")
)
PRIOR, TERMS = "estimator.fit.prior_scale", "estimator.basis.deflection_terms"
SEARCH = ("--trials", "8", "--batch", "4")
WINDOWS = (
    "tune.parameters={'estimator.side.window'={low=0.2,high=0.4}, "
    "'estimator.side.fit.prior_scale'={low=1e8,high=1e12}}"
)
COMMANDS = {
    "serial-sweep": ("sweep", SERIAL, "--grid", f"{PRIOR}=0.1,1", "--grid", f"{TERMS}=1,2"),
    "serial-montecarlo": ("montecarlo", SERIAL, "--scenarios", "16", "--sensitivity", "8"),
    "serial-gradient": ("tune", SERIAL),
    "serial-grid": ("tune", SERIAL, "--method", "grid"),
    "serial-hybrid": ("tune", SERIAL, "--method", "hybrid", "--starts", "1"),
    "serial-tpe": ("tune", LAWS, "--method", "tpe", *SEARCH),
    "serial-cmaes": ("tune", SERIAL, "--method", "cmaes", *SEARCH),
    "serial-pareto": ("tune", LAWS, "--method", "pareto", *SEARCH),
    "serial-compare": ("compare", SERIAL, RIGID, "-s", SERIAL),
    "serial-contest": ("contest", LAWS, "--trials", "4", "--batch", "4"),
    "damping-sweep": ("sweep", DAMPING, "--grid", "controller.conic.lead=0,0.03"),
    "damping-montecarlo": ("montecarlo", DAMPING, "--scenarios", "16"),
    "damping-gradient": ("tune", DAMPING),
    "damping-grid": ("tune", DAMPING, "--method", "grid"),
    "damping-compare": ("compare", DAMPING, "runs/damping-grid/best.toml", "-s", DAMPING),
    "antagonistic-sweep": ("sweep", PAIR, "--grid", "estimator.side.fit.prior_scale=1e8,1e10"),
    "antagonistic-montecarlo": ("montecarlo", PAIR, "--scenarios", "16"),
    "antagonistic-cmaes": ("tune", PAIR, "--method", "cmaes", "--trials", "4", "--batch", "4", "--set", WINDOWS),
    "arm-stiffness": ("stiffness", ARM),
    "arm-workspace": ("workspace", ARM),
    "arm-poses": ("poses", ARM),
    "arm-montecarlo": ("montecarlo", ARM),
    "log-gradient": ("tune", LOG),
}


def remove(*names: str) -> Callable[[Path], None]:
    """Return what takes files and folders of a run away, as if it had not come to them."""

    def cut(run: Path) -> None:
        for name in names:
            path = run / name
            shutil.rmtree(path) if path.is_dir() else path.unlink()

    return cut


def cut_journal(run: Path) -> None:
    """Leave of a search its first batch, and half a line of the second."""
    (run / "results.parquet").unlink()
    (run / "best.toml").unlink()
    journal = run / "optuna.log"
    lines = journal.read_text(encoding="utf-8").splitlines(keepends=True)
    first = next(i for i, line in enumerate(lines) if "whole_batches" in line)
    journal.write_text("".join(lines[: first + 1]) + lines[first + 1][:40], encoding="utf-8")


RESULTS, BEST = "results.parquet", "best.toml"
UNFINISHED = {
    "serial-sweep": remove("chunks/000001.parquet", RESULTS, BEST),
    "damping-sweep": remove("chunks", RESULTS, BEST),
    "damping-montecarlo": remove("chunks", RESULTS, "summary.json"),
    "damping-compare": remove("chunks/001.parquet", RESULTS),
}
UNFINISHED_AT_LENGTH = {
    "serial-contest": remove("rigid", f"compare/{RESULTS}", "compare/chunks/001.parquet"),
    "serial-montecarlo": remove("chunks", "design", RESULTS, "summary.json"),
    "serial-gradient": remove("chunks/start-001.parquet", RESULTS, BEST),
    "serial-grid": remove("chunks", RESULTS, BEST),
    "serial-tpe": cut_journal,
    "serial-cmaes": cut_journal,
    "serial-pareto": cut_journal,
    "serial-compare": remove("chunks/001.parquet", RESULTS),
    "damping-grid": remove("chunks", RESULTS, BEST),
    "antagonistic-sweep": remove("chunks", RESULTS, BEST),
    "antagonistic-montecarlo": remove("chunks", RESULTS, "summary.json"),
    "antagonistic-cmaes": remove("optuna.log", RESULTS, BEST),
}
"""What is taken away of a run; the rest is what it goes on from. All but the first are for the slow tests."""
WITHOUT_RESUME = tuple(name for name in COMMANDS if name.startswith(("arm", "log")))
"""Runs that could not be taken up: a folder of an arm was written anew, and one of a log refused."""
FINISHED = ("serial-montecarlo",)
REPORTED = WITHOUT_RESUME
"""Runs that are looked at by every run of the tests; the others are for the slow ones."""


def some(first: Collection[str], names: Iterable[str]) -> list[Any]:
    """Return cases, of which those that are not among the first are slow."""
    return [name if name in first else pytest.param(name, marks=pytest.mark.slow) for name in names]


@pytest.fixture
def lab(tmp_path, monkeypatch) -> Path:
    """A copy of the golden folder, from which commands are called."""
    copied = Path(shutil.copytree(LAB, tmp_path / "lab"))
    monkeypatch.chdir(copied)
    return copied


def resume(vsajax, name: str) -> dict[str, Any]:
    """Go on with a run and return what it prints for machines."""
    command, *words = COMMANDS[name]
    ended = vsajax(command, *words, "-o", f"runs/{name}", "--resume", "--json")
    assert (ended.code, ended.err) == (0, "")
    return json.loads(ended.out)


def is_as_it_was(found: Any, printed: Any, place: str = "") -> None:
    """Check that all that was printed is there: numbers up to rounding, and but for the time that it took."""
    if isinstance(printed, dict):
        for key, value in printed.items():
            assert key in found, f"{place}.{key}"
            if key != "seconds":
                is_as_it_was(found[key], value, f"{place}.{key}")
    elif isinstance(printed, list):
        assert len(found) == len(printed), place
        for i, pair in enumerate(zip(found, printed, strict=True)):
            is_as_it_was(*pair, f"{place}[{i}]")
    elif isinstance(printed, float):
        assert found == pytest.approx(printed, rel=1e-6, abs=1e-12), place
    else:
        assert found == printed, place


def tables(run: Path) -> dict[str, pa.Table]:
    """Return the tables of a run by the names of their files, without what time took."""
    found = {path.relative_to(run).as_posix(): pq.read_table(path) for path in sorted(run.rglob("*.parquet"))}
    return {
        name: table.drop_columns([c for c in table.column_names if c == "seconds"])
        for name, table in found.items()
    }


def has_its_tables(run: Path, name: str, **tolerances: float) -> None:
    """Check that a run has the tables that it had, of the same columns and types, up to tolerances."""
    found, expected = tables(run), tables(LAB / "runs" / name)
    assert found.keys() == expected.keys()
    for file, table in expected.items():
        assert found[file].schema.equals(table.schema), file
        for column in table.column_names:
            ours, theirs = found[file][column].to_numpy(), table[column].to_numpy()
            if theirs.dtype.kind == "f":
                np.testing.assert_allclose(ours, theirs, **tolerances, err_msg=f"{file}: {column}")
            else:
                np.testing.assert_array_equal(ours, theirs, err_msg=f"{file}: {column}")


@pytest.mark.cli
@pytest.mark.equivalence
@pytest.mark.parametrize("name", some(UNFINISHED, UNFINISHED | UNFINISHED_AT_LENGTH))
def test_an_unfinished_run_goes_on_to_the_results_that_it_would_have_had(name, lab, vsajax):
    run = lab / "runs" / name
    (UNFINISHED | UNFINISHED_AT_LENGTH)[name](run)
    left = {path: path.read_bytes() for path in [*run.rglob("chunks/*.parquet"), run / "manifest.json"]}
    is_as_it_was(resume(vsajax, name), PRINTED[name]["run"])
    # What was there is neither written nor computed again.
    assert {path: path.read_bytes() for path in left} == left
    has_its_tables(run, name, rtol=1e-6, atol=1e-12)


@pytest.mark.cli
@pytest.mark.equivalence
@pytest.mark.parametrize("name", some(FINISHED, [name for name in COMMANDS if name not in WITHOUT_RESUME]))
def test_a_finished_run_stays_as_it_is_to_the_bit(name, lab, vsajax):
    is_as_it_was(resume(vsajax, name), PRINTED[name]["run"])
    has_its_tables(lab / "runs" / name, name, rtol=0.0, atol=0.0)
    best = LAB / "runs" / name / BEST
    if best.is_file():
        assert numeric_paths(load_config(lab / "runs" / name / BEST)) == numeric_paths(load_config(best))


@pytest.mark.cli
@pytest.mark.parametrize("name", ["serial-sweep", "serial-gradient"])
def test_a_run_of_an_earlier_edition_of_the_answers_is_reported_but_does_not_go_on(name, lab, vsajax):
    command, *words = COMMANDS[name]
    left = {path: path.read_bytes() for path in (lab / "earlier" / name).rglob("*") if path.is_file()}
    ended = vsajax(command, *words, "-o", f"earlier/{name}", "--resume")
    assert ended.code == 2
    assert "begun by another version of vsajax: its answers are of edition 1, not 2" in ended.err
    assert "name a new folder with -o; vsajax report still reads this one" in ended.err
    assert {path: path.read_bytes() for path in (lab / "earlier" / name).rglob("*") if path.is_file()} == left
    reported = vsajax("report", f"earlier/{name}", "-o", "page.html", "--json")
    assert (reported.code, reported.err) == (0, "")


@pytest.mark.cli
@pytest.mark.parametrize("name", some(REPORTED, COMMANDS))
def test_a_report_says_what_the_run_found(name, lab, vsajax):
    ended = vsajax("report", f"runs/{name}", "-o", "page.html", "--json")
    assert (ended.code, ended.err) == (0, "")
    said, before = json.loads(ended.out), PRINTED[name]["report"]
    # What a kind scores on may be no noise draw.
    assert said["headline"] == before["headline"].replace("noise draws", "scenarios")
    assert said["pictures"] == before["pictures"]
    page = (lab / "page.html").read_text(encoding="utf-8")
    assert f"vsajax {COMMANDS[name][0]}" in page


@pytest.mark.cli
@pytest.mark.parametrize(
    "name", some(["serial-sweep"], ["serial-sweep", "serial-tpe", "damping-gradient", "antagonistic-cmaes"])
)
def test_the_best_of_a_run_is_checked_simulated_and_exported(name, lab, vsajax):
    best = f"runs/{name}/best.toml"
    checked = vsajax("check", best, "--json")
    assert (checked.code, checked.err, json.loads(checked.out)["ok"]) == (0, "", True)
    simulated = vsajax("simulate", best, "-o", "recording.parquet", "--json")
    assert (simulated.code, simulated.err) == (0, "")
    study = load_config(Path(best))
    assert pq.read_metadata(lab / "recording.parquet").num_rows == round(study.clock.duration / 1e-3) + 1
    exported = vsajax("export", best, "--to", "toml", "-o", "deploy", "--duration", "0.05", "--json")
    assert (exported.code, exported.err) == (0, "")
    manifest = json.loads((lab / "deploy" / "manifest.json").read_text(encoding="utf-8"))
    assert load_config(lab / "deploy" / manifest["files"][0]) == study


@pytest.mark.cli
def test_the_best_of_a_log_is_checked_exported_and_estimates(lab, vsajax):
    best = "runs/log-gradient/best.toml"
    for words in (
        ("check", best),
        ("estimate", "studies/log.csv", "-c", best, "-o", "estimate.parquet"),
        ("export", best, "--to", "toml", "-o", "deploy", "--duration", "0.05"),
    ):
        ended = vsajax(*words, "--json")
        assert (ended.code, ended.err) == (0, ""), words
    found = PRINTED["log-gradient"]["run"]
    assert pq.read_table(lab / "estimate.parquet")["stiffness"][-1].as_py() == pytest.approx(
        found["whole"]["stiffness"], rel=0.1
    )
