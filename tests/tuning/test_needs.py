"""Plans that nobody can have are refused by their numbers, within a second or two and before anything is made."""

from __future__ import annotations

import re
import resource
import time
from pathlib import Path

import pytest

from tests.tuning.builders import ANTAGONISTIC, EXAMPLES, PRIOR, SEA, SERIAL, TUNED
from tuning.files.errors import InputError
from tuning.files.shipped import CONFIGS
from tuning.problem.build import build_estimator
from tuning.scoring import needs
from tuning.scoring.needs import of_study, of_sweep
from tuning.study.base import Config
from tuning.study.limits import Need, in_bytes, in_count, in_time, limits, product, require
from tuning.study.loading import load_config, load_study
from tuning.study.structures import with_grid
from vsajax import rollout

DAMPING, ARM = CONFIGS / "studies" / "damping.toml", CONFIGS / "studies" / "arm.toml"
POPULATION, CONTEST = CONFIGS / "studies" / "serial-population.toml", CONFIGS / "contests" / "damping.toml"
CONFIG = CONFIGS / "tuned" / "sea_sensor.toml"
HEBI = Path(__file__).parents[1] / "golden" / "hebi" / "exampleLog.csv"
LOG_STUDY = CONFIGS / "log_studies" / "quanser_flex.toml"
TERMS = "estimator.basis.deflection_terms"
LONG, FINE = "--set clock.duration=1e9", "--set clock.sample_time=1e-12"
GRID = f"--grid {PRIOR}=log(1e-2,1e2,1000000000)"
MANY = 10**12
NOISE = f"{{type='noise',std=1.0,low=0.1,high=5.0,tones={MANY}}}"

PLANS = [
    *(f"{command} {option}" for option in (LONG, FINE) for command in (
        f"check {SERIAL}", f"simulate {SERIAL} -o rec.parquet", f"sweep {SERIAL} -o run",
        f"montecarlo {POPULATION} -o run", f"tune {SERIAL} -o run",
    )),
    f"simulate {DAMPING} -o rec.parquet {LONG}",
    f"compare {SERIAL} -s {SERIAL} -o run {LONG}",
    f"contest {CONTEST} -o run {FINE}",
    f"sweep {SERIAL} -o run {GRID}",
    f"sweep {SERIAL} -o run {GRID} --dry-run",
    f"sweep {SERIAL} -o run --grid {PRIOR}=lin(1,2,{10**20}) --dry-run",
    f"sweep {SERIAL} -o run --grid {PRIOR}=log(1,2,{'9' * 4000})",
    f"sweep {SERIAL} -o run --grid {PRIOR}=log(1e-2,1e2,25000000) --dry-run",
    f"sweep {SERIAL} -o run --scenarios {MANY}",
    f"check {SERIAL} --set sweep.scenarios={MANY}",
    f"montecarlo {POPULATION} -o run --scenarios {MANY}",
    f"montecarlo {POPULATION} -o run --scenarios {MANY} --dry-run",
    f"montecarlo {SERIAL} -o run --scenarios {MANY}",
    f"montecarlo {POPULATION} -o run --sensitivity {2**40}",
    f"montecarlo {POPULATION} -o run --sensitivity {2**40} --dry-run",
    f"montecarlo {POPULATION} -o run --workers 100000000",
    f"check {SERIAL} --set {TERMS}=3000",
    f"sweep {SERIAL} -o run --set {TERMS}=3000",
    f"sweep {SERIAL} -o run --grid {TERMS}=2,3000",
    f"estimate {HEBI} -c {CONFIG} -o e.parquet --set estimator.basis={{type='polynomial',order=3000}}",
    f"export {CONFIG} --to c99 -o out --set estimator.basis={{type='polynomial',order=100000}}",
    f"export {SERIAL} --to toml -o out {FINE}",
    f"export {CONFIG} --to c99 -o out --duration 1e9",
    f"export {DAMPING} --to json -o out --duration 1e12",
    f"tune {SERIAL} -o run --method tpe --batch 1000000000",
    f"tune {SERIAL} -o run --method tpe --trials {MANY}",
    f"tune {SERIAL} -o run --method cmaes --trials {10**8}",
    f"tune {SERIAL} -o run --budget {MANY}",
    f"tune {SERIAL} -o run --starts {MANY}",
    f"tune {SERIAL} -o run --method grid --set tune.parameters.'{PRIOR}'.points=1000000000",
    f"tune {SERIAL} -o run --set scenarios.train={MANY}",
    f"tune {SERIAL} -o run --set scenarios.held_out={MANY}",
    f"tune {LOG_STUDY} -o run --budget {MANY}",
    f"check {LOG_STUDY} --set tune.screen={MANY}",
    f"contest {CONTEST} -o run --trials {MANY}",
    f"contest {CONTEST} -o run --batch {MANY}",
    f"compare {SERIAL} -s {SERIAL} -o run --scenarios {MANY}",
    f"simulate {SERIAL} -o rec.parquet --set substeps={MANY}",
    f"simulate {SERIAL} -o rec.parquet --set excitation.motor={NOISE}",
    f"simulate {POPULATION} -o rec.parquet --scenario {MANY}",
    f"simulate {SERIAL} -o rec.parquet --scenario {10**20}",
    f"check {ANTAGONISTIC} --set estimator.side.longest_window=1e9",
    f"check {DAMPING} --set sensor.longest_delay=1000000 --set sensor.delay=0.01",
    f"workspace {ARM} -o run --set workspace.poses={MANY}",
    f"workspace {ARM} -o run --set workspace.cells=1000000",
    f"poses {ARM} -o run --set poses.targets={MANY}",
    f"poses {ARM} -o run --set poses.steps={MANY}",
    f"montecarlo {ARM} -o run --scenarios {MANY}",
    f"check {ARM} --set accuracy.draws={MANY}",
]  # fmt: skip


def short(plan: str) -> str:
    return re.sub(r"\S*/", "", plan)[:110]


@pytest.mark.failure
@pytest.mark.cli
@pytest.mark.parametrize("plan", PLANS, ids=short)
def test_a_plan_that_cannot_be_is_refused_at_once(plan, vsajax, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    held, began = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    ended = vsajax(*plan.split())
    assert time.process_time() - began < 5.0  # Of this processor: most of it imports, one second.
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - held < 500 * 1024
    assert (ended.code, ended.out) == (2, "")
    assert ended.err.startswith("error: ")
    assert "\n    fix: " in ended.err
    assert "raise the limit: set VSAJAX_" in ended.err or "scenarios; there are" in ended.err
    assert len(ended.err) < 3000
    assert list(tmp_path.iterdir()) == []


def test_what_is_refused_says_how_much_it_is_what_it_takes_and_what_raises_the_limit(vsajax):
    said = vsajax("check", SERIAL, "--set", "clock.duration=1e9").err
    assert f"{SERIAL}: clock: 1,000,000,000,001 samples (1e+09 s, one every 0.001 s)" in said
    assert re.search(r"needs about \d+ TiB of memory, [\d.]+ (days|years) of work; allowed: ", said)
    assert "check the units, seconds, of clock.duration and clock.sample_time" in said
    assert "set VSAJAX_MEMORY_GIB and VSAJAX_HOURS in the environment" in said


@pytest.mark.parametrize("path", [*EXAMPLES, *TUNED], ids=lambda path: path.stem)
def test_shipped_studies_fit_a_small_machine(path, monkeypatch):
    monkeypatch.setenv("VSAJAX_MEMORY_GIB", "4")
    monkeypatch.setenv("VSAJAX_HOURS", "24")
    config = load_config(path)
    require(*(of_study(config, "here") if type(config) is not Config else []))


@pytest.mark.contract
@pytest.mark.parametrize("path", [*TUNED, SERIAL, SEA, ANTAGONISTIC], ids=lambda path: path.stem)
def test_coefficients_are_counted_as_the_built_estimator_has_them(path):
    config = load_config(path)
    if not isinstance(config, Config):
        return
    built = build_estimator(config)
    bases = [part.basis for part in (getattr(built, "side", built), getattr(built, "other", None)) if part]
    assert config.estimator.size == max(basis.size for basis in bases)


@pytest.mark.parametrize(
    "basis",
    [
        "{type='odd', deflection_terms=3, setpoint_terms=2, torque_bias=true}",
        "{type='odd', deflection_terms=3, deflection_offset=true, torque_bias=true}",
        "{type='polynomial', order=4}",
        "{type='taylor', order=3}",
        "{type='legendre', lower=-1.0, upper=1.0, order=5}",
    ],
)
def test_every_basis_is_counted(basis):
    config = load_study(SERIAL, [f"estimator.basis={basis}"])
    assert config.estimator.basis.size == build_estimator(config).basis.size


def test_a_limit_can_be_raised_and_lowered(monkeypatch, vsajax):
    need = of_sweep(with_grid(load_study(SERIAL), [f"{PRIOR}=log(1,2,100000000)"], 16), "--grid")
    with pytest.raises(InputError, match="1,600,000,000 rows of results: needs about"):
        require(need)
    monkeypatch.setenv("VSAJAX_MEMORY_GIB", "1e6")
    with pytest.raises(InputError, match="set VSAJAX_HOURS in"):
        require(need)
    monkeypatch.setenv("VSAJAX_HOURS", "1e6")
    require(need)
    monkeypatch.setenv("VSAJAX_HOURS", "1e-9")
    assert "VSAJAX_HOURS" in vsajax("check", SERIAL).err
    for text in ("much", "-1", "0", "nan"):
        monkeypatch.setenv("VSAJAX_HOURS", text)
        with pytest.raises(InputError, match=f"VSAJAX_HOURS: got '{text}'; needs a positive number"):
            limits()


def test_numbers_beyond_all_floats_are_too_many():
    huge = Need("here", "much", "less", memory=product(10**4000, 3) * 0.0)
    with pytest.raises(InputError, match="here: much"):
        require(huge)
    assert in_count(10**4000) == "more than 1e308"
    assert (in_count(25_000_000), in_count(10**20)) == ("25,000,000", "1e+20")
    assert (in_bytes(3 * 2**30), in_bytes(5e18)) == ("3 GiB", "4,547,474 TiB".replace("4,547,474", "4.5e+06"))
    assert (in_time(30.0), in_time(7200.0), in_time(1e9)) == ("30 s", "2 h", "31.7 years")


def test_lanes_are_counted_as_they_are_computed():
    assert needs._LANES == rollout.LANES_PER_CHUNK
