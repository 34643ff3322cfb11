"""An arm as a kind of study like the others: its scenarios, and every command that scores them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pyarrow.parquet as pq
import pytest

from tuning.cli.main import cli
from tuning.files.errors import InputError
from tuning.files.shipped import example_path
from tuning.files.whole import write_table
from tuning.kinds.arm.accuracy import summarise
from tuning.kinds.arm.bench import NUMBERS
from tuning.kinds.arm.deployable import deployable_of
from tuning.kinds.arm.problem import ArmProblem
from tuning.kinds.arm.run import write_run
from tuning.problem.interface import Differentiable, Status
from tuning.runs.executors import DaskExecutor, Inline
from tuning.runs.manifest import read_manifest
from tuning.runs.workers import planner_of, spec_of
from tuning.scoring import montecarlo
from tuning.scoring.montecarlo import MonteCarlo, compute_population
from tuning.search.refine import plan_search
from tuning.study.base import ROBOTS, resolved, study_hash
from tuning.study.loading import load_study
from tuning.study.paths import numeric_paths

ARM = example_path("arm", "arm")
STIFFEST, UPPER = "controller.max_stiffness", "joints.upper"
_STAGES = f"'{STIFFEST}'={{low=600.0, high=9000.0, points=2}}, '{UPPER}'={{low=450.0, high=900.0, points=2}}"
BOUNDS = f"tune.parameters={{{_STAGES}}}"
# As many of each: what is compiled for one serves the others.
FEW = ("scenarios={train=6, held_out=6}", BOUNDS)
LANES = 16
ROBOT = """<robot name="elbowed"><link name="base"/><link name="upper"/><link name="fore"/><link name="hand"/>
<joint name="waist" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.3"/>
  <axis xyz="0 0 1"/><limit lower="-1.5" upper="1.5"/></joint>
<joint name="shoulder" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0 0 0.1"/>
  <axis xyz="0 1 0"/><limit lower="-1.5" upper="1.5"/></joint>
<joint name="elbow" type="revolute"><parent link="fore"/><child link="hand"/><origin xyz="0.4 0 0"/>
  <axis xyz="0 1 0"/><limit lower="0.3" upper="1.5"/></joint></robot>"""


def settings(*given: str) -> list[str]:
    return [word for setting in given for word in ("--set", setting)]


def answer(ended, code: int = 0) -> dict:
    assert (ended.code, ended.err) == (code, "")
    return json.loads(ended.out)


@pytest.fixture
def own(tmp_path, monkeypatch) -> Path:
    """A study of an arm of three joints from a URDF beside it, in an empty folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "elbowed.urdf").write_text(ROBOT)
    path = tmp_path / "own.toml"
    path.write_text(
        'schema_version = 1\nkind = "arm"\nname = "elbowed"\n'
        'arm = {urdf = "elbowed.urdf", tip = "hand", tool = {offset = [0.3, 0.0, 0.0]}}\n'
        "joints = {lower = 50.0, upper = 500.0}\ntask = {stiffness = [200.0, 300.0, 400.0]}\n"
        "accuracy = {msrep = [0.01, 1.0], draws = 20}\n"
    )
    return path


# What a scenario is.


@pytest.mark.equivalence
def test_a_scenario_is_the_same_however_many_are_drawn_and_wherever_they_begin(own):
    problem = ArmProblem(load_study(own))

    def drawn(count: int, start: int = 0) -> tuple[np.ndarray, np.ndarray]:
        found = problem.scenarios("population", count, start)
        return np.asarray(jax.random.key_data(found.key)), np.asarray(found.numbers["msrep"])

    keys, levels = drawn(12)
    np.testing.assert_array_equal(levels, [0.01, 1.0] * 6)
    # Both levels see the same draw; no draw comes twice.
    np.testing.assert_array_equal(keys[::2], keys[1::2])
    assert len(np.unique(keys, axis=0)) == 6
    for start, count in ((0, 1), (1, 1), (3, 5), (4, 8)):
        for part, whole in zip(drawn(count, start), (keys, levels), strict=True):
            np.testing.assert_array_equal(part, whole[start : start + count])
    other = np.asarray(jax.random.key_data(problem.scenarios("train", 12).key))
    assert len(np.unique(np.concatenate([keys, other]), axis=0)) == 12


def chunk_of(study) -> dict[str, np.ndarray]:
    """Return the rows of the first scenarios of a study."""
    return MonteCarlo(study, LANES).run_chunk("000000")


@pytest.mark.oracle
def test_the_scores_are_those_of_a_hand_whose_joints_are_off(own):
    study = load_study(own)
    problem, found = ArmProblem(study), chunk_of(study)
    scenarios = problem.scenarios("population", LANES)
    assert (found["status"] == Status.OK).all()
    low, high = np.asarray(problem.bench.ranges).T
    design_at = eqx.filter_jit(lambda bench, positions: (bench.design(positions), bench.jacobian(positions)))
    for i in range(LANES):
        key, msrep = scenarios.key[i], found["msrep"][i]
        positions = jax.random.uniform(jax.random.fold_in(key, 0), (3,), minval=low, maxval=high)
        errors = np.asarray(jax.random.normal(jax.random.fold_in(key, 1), (3,))) * np.sqrt(msrep / 100.0)
        design, jacobian = design_at(problem.bench, positions)
        hand = np.asarray(design.active) + (jacobian / (design.joint_stiffness * (1.0 + errors))) @ jacobian.T
        desired, designed = np.diag([200.0, 300.0, 400.0]), np.linalg.inv(np.asarray(design.serial))
        for name, reference in (("stiffness_error", desired), ("stiffness_change", designed)):
            expected = np.linalg.norm(np.linalg.inv(hand) - reference) / np.linalg.norm(reference)
            np.testing.assert_allclose(found[name][i], expected, rtol=1e-9)


@pytest.mark.statistical
def test_the_joints_are_off_by_their_level(own):
    study = load_study(own, ["accuracy.msrep=[4.0]"])
    keys = ArmProblem(study).scenarios("population", 4000).key
    errors = jax.vmap(lambda key: jax.random.normal(jax.random.fold_in(key, 1), (3,)))(keys)
    # The variance of a squared normal number is 2: one standard error of 12,000 of them is 1.3 %.
    np.testing.assert_allclose(np.mean(np.square(errors)), 1.0, atol=5 * np.sqrt(2.0 / 12000.0))


@pytest.mark.failure
def test_what_has_no_usable_design_has_no_score_and_says_so(own):
    too_stiff = chunk_of(load_study(own, ["task.stiffness=[200.0, 300.0, 90000.0]"]))
    assert (too_stiff["status"] == Status.NO_DESIGN).all()
    assert (too_stiff["diverged"] == 1.0).all()
    for name in ("stiffness_error", "compliance_error", "stiffness_change"):
        assert np.isnan(too_stiff[name]).all()


@pytest.mark.structure
def test_every_number_of_the_study_has_its_place_in_the_bench(own):
    study = load_study(own)
    assert numeric_paths(study).keys() == NUMBERS.keys()
    bench = ArmProblem(study).bench
    for i, (path, value) in enumerate(numeric_paths(study).items()):
        np.testing.assert_array_equal(NUMBERS[path](bench), value)
        changed = bench.with_values({path: jnp.asarray(1.0 + i)})
        np.testing.assert_array_equal(NUMBERS[path](changed), 1.0 + i)


# What a file of it is.


@pytest.mark.contract
def test_tables_that_came_later_change_no_hash_until_they_say_something():
    plain = load_study(ARM)
    assert {"population", "scenarios", "sweep", "tune"}.isdisjoint(resolved(plain))
    spelt = load_study(
        ARM, ["sweep={}", "scenarios={train=32, held_out=256}", "tune={objective='stiffness_error'}"]
    )
    assert study_hash(spelt) == study_hash(plain)
    for given in (
        f"sweep.grid={{'{STIFFEST}'=[1.0, 2.0]}}",
        "scenarios.train=3",
        "tune.objective='stiffness_change'",
    ):
        told = load_study(ARM, [given])
        assert study_hash(told) != study_hash(plain)
        assert given.split(".")[0] in resolved(told)


@pytest.mark.cli
@pytest.mark.failure
def test_another_kinds_objective_is_refused(vsajax, own):
    ended = vsajax("check", own, *settings("tune.objective=msrep"))
    assert ended.code == 2
    assert "tune.objective: got 'msrep', which a study of kind 'arm' does not score" in ended.err
    assert "allowed: stiffness_error, compliance_error, stiffness_change" in ended.err


@pytest.mark.cli
def test_a_urdf_is_found_wherever_a_command_runs(own, tmp_path, monkeypatch, vsajax):
    here = load_study(own)
    (tmp_path / "deep").mkdir()
    monkeypatch.chdir(tmp_path / "deep")
    there = load_study(Path("../own.toml"))
    # Where it lies is kept, and is no part of what it is.
    assert here.provenance == {"folder": str(tmp_path)}
    assert study_hash(here) == study_hash(there)
    assert there.chain.names == ("waist", "shoulder", "elbow")
    # What is exported is read where it goes, and has the URDF beside it.
    exported = deployable_of(here, "own.toml")
    assert (exported.config.provenance, exported.config.arm.urdf) == ({}, "elbowed.urdf")
    assert exported.companions == {"elbowed.urdf": ROBOT.encode()}
    copied = tmp_path / "deep" / "copy.toml"
    copied.write_text(vsajax("check", own).out)
    assert load_study(copied).provenance == here.provenance
    # Beside the study it is found before where it lay when the study was written.
    shutil.copy(tmp_path / "elbowed.urdf", tmp_path / "deep")
    assert load_study(copied).folder == tmp_path / "deep"
    (tmp_path / "deep" / "elbowed.urdf").unlink()
    (tmp_path / "elbowed.urdf").unlink()
    with pytest.raises(InputError, match=r"arm\.urdf"):
        load_study(copied)


@pytest.mark.slow(twin="test_a_urdf_is_found_wherever_a_command_runs")
@pytest.mark.cli
def test_what_is_exported_is_read_back_with_the_urdf_beside_it(vsajax, own, tmp_path):
    told = answer(vsajax("export", own, "--to", "toml", "-o", "deploy", "--duration", "0.1", "--json"))
    assert (told["ok"], {check["state"] for check in told["checks"]}) == (True, {"passed"})
    (tmp_path / "elbowed.urdf").unlink()
    assert load_study(tmp_path / "deploy" / "designer.toml").folder == tmp_path / "deploy"


# Monte Carlo.


@pytest.fixture
def in_chunks(monkeypatch) -> None:
    """Runs of 40 scenarios in three chunks."""
    monkeypatch.setattr(montecarlo, "_STEPS_PER_CHUNK", 1.0)


@pytest.mark.cli
@pytest.mark.equivalence
def test_montecarlo_goes_on_after_it_was_stopped_to_the_same_bytes(vsajax, own, tmp_path, monkeypatch, in_chunks):
    straight = answer(vsajax("montecarlo", own, "-o", "straight", "--json"))
    assert straight["run"] == "straight"
    assert straight["files"] == [
        f"straight/{name}" for name in ("manifest.json", "results.parquet", "accuracy.png")
    ]
    assert (straight["ok"], straight["joints"]) == (True, ["waist", "shoulder", "elbow"])
    assert [row["msrep"] for row in straight["levels"]] == [0.01, 1.0]
    assert pq.ParquetFile(tmp_path / "straight" / "results.parquet").metadata.num_rows == 2 * 20

    compute, done = MonteCarlo.run_chunk, []

    def run_chunk(self, chunk):
        if len(done) == 2:
            raise KeyboardInterrupt
        done.append(chunk)
        return compute(self, chunk)

    with monkeypatch.context() as patch:
        patch.setattr(MonteCarlo, "run_chunk", run_chunk)
        ended = vsajax("montecarlo", own, "-o", "cut", "-q")
    assert (ended.code, "run the same command with --resume" in ended.err) == (3, True)
    assert not (tmp_path / "cut" / "results.parquet").exists()
    ended = vsajax("montecarlo", own, "-o", "cut")
    assert (ended.code, "go on with --resume" in ended.err) == (2, True)
    # It goes on from another folder too: the study is read there, and what it names is found.
    (tmp_path / "deep").mkdir()
    monkeypatch.chdir(tmp_path / "deep")
    done.clear()
    resumed = answer(vsajax("montecarlo", "../own.toml", "-o", "../cut", "--resume", "--json"))
    assert resumed["levels"] == straight["levels"]
    names = ["results.parquet", *(f"chunks/{chunk:06d}.parquet" for chunk in range(3))]
    for name in names:
        assert (tmp_path / "cut" / name).read_bytes() == (tmp_path / "straight" / name).read_bytes()
    # What the URDF held belongs to the run.
    (tmp_path / "elbowed.urdf").write_text(ROBOT.replace("0.4 0 0", "0.5 0 0"))
    ended = vsajax("montecarlo", "../own.toml", "-o", "../cut", "--resume")
    assert (ended.code, "elbowed.urdf: has changed since the run" in ended.err) == (2, True)


@pytest.mark.equivalence
def test_a_worker_elsewhere_computes_the_same_chunk_from_the_manifest(own, tmp_path, monkeypatch, in_chunks):
    study = load_study(own)
    run = MonteCarlo(study, study.robots(None))
    run.open(tmp_path / "run", resume=False)
    (tmp_path / "worker").mkdir()
    monkeypatch.chdir(tmp_path / "worker")
    planner = planner_of(spec_of(read_manifest(tmp_path / "run" / "manifest.json")))
    assert planner.chunks == run.chunks
    for name, values in run.run_chunk("000001").items():
        np.testing.assert_array_equal(planner.run_chunk("000001")[name], values)


@pytest.mark.slow(
    twin=(
        "test_a_worker_elsewhere_computes_the_same_chunk_from_the_manifest",
        "tests/tuning/test_executors.py::test_workers_give_the_bytes_of_a_run_in_one_process",
    )
)
@pytest.mark.equivalence
def test_processes_give_the_bytes_of_one(own, tmp_path):
    run = MonteCarlo(load_study(own), LANES)
    for name, executor in (("one", Inline()), ("many", DaskExecutor(2))):
        compute_population(run, tmp_path / name, executor, quiet=True)
    one, many = ((tmp_path / name / "results.parquet").read_bytes() for name in ("one", "many"))
    assert one == many


@pytest.mark.cli
def test_the_level_of_a_run_is_that_of_its_robots(vsajax, own, tmp_path, in_chunks):
    write_table(tmp_path / "robots" / "results.parquet", {"msrep_settled": [1.0] * 5})
    given = settings("accuracy.run=robots", "accuracy.msrep=[1.0]")
    level, run = answer(vsajax("montecarlo", own, "-o", "a", "--json", *given))["levels"]
    assert (level["msrep"], run["msrep"]) == (1.0, "run")
    assert run["stiffness_change_median"] == level["stiffness_change_median"]
    # A robot whose estimate diverged leaves no stiffness to set.
    write_table(tmp_path / "robots" / "results.parquet", {"msrep_settled": [np.nan, *[1.0] * 4]})
    ended = vsajax("montecarlo", own, "-o", "a", "--resume", *given)
    assert (ended.code, "robots/results.parquet: has changed" in ended.err) == (2, True)
    lost = answer(vsajax("montecarlo", own, "-o", "b", "--scenarios", "200", "--json", *given))["levels"][1]
    assert lost["failed"] == pytest.approx(200 * (1 - 0.8**3), abs=30)
    status = pq.read_table(tmp_path / "b" / "results.parquet")["status"].to_numpy()
    assert np.sum(status == Status.ESTIMATE_DIVERGED) == lost["failed"]


@pytest.mark.cli
def test_failures_are_told_at_each_level(vsajax, own, in_chunks):
    failures = 'population.failures={off="stiffness_change > 0.05"}'
    told = answer(vsajax("montecarlo", own, "-o", "run", "--json", *settings(failures)))["levels"]
    columns = pq.read_table("run/results.parquet").to_pydict()
    change, level = np.array(columns["stiffness_change"]), np.array(columns["msrep"])
    for row in told:
        assert row["failures"] == {"off": np.mean(change[level == row["msrep"]] > 0.05)}
    assert told[0]["failures"]["off"] < told[1]["failures"]["off"]
    assert "stiffness_change > 0.05" in vsajax("montecarlo", own, "-o", "run", "--resume", *settings(failures)).out


@pytest.mark.contract
def test_how_many_robots_a_run_has_is_said(own):
    study = load_study(own)
    assert (study.robots(None), study.robots(7)) == (2 * 20, 2 * 7)
    (scenarios,) = (p for p in cli.commands["montecarlo"].params if p.name == "scenarios")
    assert f"by default {ROBOTS}" in scenarios.help


# Searches.


@pytest.mark.cli
def test_an_arm_is_swept_over_numbers_and_settings_and_its_winner_goes_on(vsajax, own, tmp_path):
    grid = ["--grid", f"{STIFFEST}=600,4545", "--grid", "controller.scaling=none,exact", "--scenarios", "6"]
    forecast = answer(vsajax("sweep", own, "-o", "runs/s", *grid, "--dry-run", "--json"))
    assert (forecast["configurations"], forecast["scenarios"]) == (4, 6)
    swept = answer(vsajax("sweep", own, "-o", "runs/s", *grid, "--json"))
    best = swept["best"][0]
    assert {row["diverged"] for row in swept["best"]} == {0}
    winner = load_study(tmp_path / "runs" / "s" / "best.toml")
    assert (winner.controller.max_stiffness, winner.controller.scaling) == (
        best[STIFFEST],
        best["controller.scaling"],
    )
    # The URDF lies beside the study, not beside what was written.
    assert winner.folder == tmp_path
    told = answer(vsajax("report", "runs/s", "--json"))
    assert "mean relative error of the hand's stiffness" in told["headline"]
    page = (tmp_path / "runs" / "s" / "report.html").read_text().split("base64")
    assert "relative change of the hand" in "".join(page)
    assert "convergence time" not in "".join(page)


@pytest.mark.cli
@pytest.mark.parametrize("method", [pytest.param("grid", marks=pytest.mark.slow), "tpe"])
def test_an_arm_is_tuned(vsajax, own, tmp_path, method):
    trials = ["--trials", "12", "--batch", "4"] if method == "tpe" else []
    found = answer(vsajax("tune", own, "-o", "run", "--method", method, *trials, *settings(*FEW), "--json"))
    assert "convergence_time" not in {**found["train"], **found["held_out"]}
    best = load_study(tmp_path / "run" / "best.toml")
    assert (best.controller.max_stiffness, best.joints.upper) == (
        found["values"][STIFFEST],
        found["values"][UPPER],
    )
    assert best.folder == tmp_path
    # No trial was better.
    columns = pq.read_table(tmp_path / "run" / "results.parquet").to_pydict()
    assert found["train"]["value"] == pytest.approx(min(columns["objective"]), rel=1e-9)
    said = vsajax("tune", own, "-o", "run", "--method", method, *trials, *settings(*FEW), "--resume").out
    assert "converged" not in said
    told = answer(vsajax("report", "run", "--json"))
    assert told["headline"].startswith("Tuning takes mean relative error of the hand's stiffness")
    page = (tmp_path / "run" / "report.html").read_text()
    assert "What tuning changed" in page
    assert STIFFEST in page


@pytest.mark.cli
def test_arms_are_compared_and_put_into_a_contest(vsajax, own, tmp_path):
    soft = tmp_path / "soft.toml"
    soft.write_text(own.read_text() + "\n[controller]\nmax_stiffness = 600.0\n")
    compared = answer(vsajax("compare", own, "soft.toml", "-s", own, "-o", "run", *settings(*FEW), "--json"))
    first, second = compared["configs"]
    assert (first["verdict"], second["scenarios"]) == ("first", 6)
    assert second["difference"] == pytest.approx(second["value"] - first["value"], rel=1e-9)
    assert "convergence_time" not in first
    assert "Best of 2: " in answer(vsajax("report", "run", "--json"))["headline"]
    # The same two as options of a choice, which has nothing to tune beside.
    choices = f"tune.choices={{stage={{own={{}}, soft={{'{STIFFEST}'=600.0}}}}}}"
    given = [*settings(FEW[0], choices), "--method", "tpe"]
    held = answer(vsajax("contest", own, "-o", "contest", *given, "--json"))
    assert {row["config"]: row["value"] for row in held["configs"]} == pytest.approx(
        {"own": first["value"], "soft": second["value"]}, rel=1e-9
    )
    assert "Best of 2: " in answer(vsajax("report", "contest", "--json"))["headline"]


# What it has not, in words.


@pytest.mark.cli
@pytest.mark.failure
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("tune", "-o", "run", "--method", "gradient"), ["kind 'arm' has no gradient (", "--method cmaes"]),
        (("tune", "-o", "run", "--method", "hybrid"), ["kind 'arm' has no gradient (", "--method cmaes"]),
        (("tune", "-o", "run", "--method", "pareto"), ["kind 'arm' has no convergence time (", "cmaes or tpe"]),
        (("simulate",), ["kind 'arm' has no signals over time", "vsajax stiffness, workspace"]),
        (("montecarlo", "-o", "run", "--precision", "0.1"), ["--precision does not go with kind 'arm'"]),
        (("montecarlo", "-o", "run", "--sensitivity", "8"), ["--sensitivity does not go with kind 'arm'"]),
        (("montecarlo", "-o", "run", "--worst", "8"), ["--worst does not go with kind 'arm'"]),
        (("contest", "-o", "run"), ["tune.choices: leave fewer than two contestants"]),
        (("sweep", "-o", "run"), ["sweep.grid: has no axis", "--grid joints.lower=log(5,500,8)"]),
    ],
)
def test_what_an_arm_has_not_is_refused_in_words(vsajax, own, tmp_path, words, said):
    before = sorted(tmp_path.rglob("*"))
    command, *options = words
    ended = vsajax(command, own, *options, *settings(*FEW))
    assert (ended.code, ended.out) == (2, "")
    for part in said:
        assert part in ended.err
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.contract
def test_only_what_is_differentiable_is_searched_by_the_gradient(own):
    study = load_study(own, [BOUNDS])
    assert not isinstance(ArmProblem(study), Differentiable)
    assert plan_search(study, "grid", "bfgs", "own.toml").method == "grid"
    with pytest.raises(InputError, match="has no gradient"):
        plan_search(study, "gradient", "bfgs", "own.toml")


# Folders from before.


@pytest.mark.equivalence
@pytest.mark.cli
def test_a_montecarlo_folder_from_before_the_common_runs_is_still_reported(vsajax, own, tmp_path):
    study = load_study(own)
    columns = {
        "msrep": np.repeat([0.01, 1.0], 4),
        "stiffness_error": np.linspace(0.01, 0.08, 8),
        "compliance_error": np.linspace(0.02, 0.09, 8),
        "stiffness_change": np.linspace(0.03, 0.1, 8),
    }
    write_run(tmp_path / "old", "montecarlo", study, {"ok": True, "levels": summarise(columns)}, columns)
    told = answer(vsajax("report", "old", "--json"))
    assert told["headline"].startswith(
        "At an MSREP of 1 % in the joints the hand's stiffness is off its design by 8.5 %"
    )
