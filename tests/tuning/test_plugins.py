"""Parts, kinds, scores, formats and papers of others: found, consented to, recorded, or refused."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from tests.tuning.builders import SEA
from tests.tuning.conftest import forget_modules
from tests.tuning.plugin import EXAMPLE, ROOT, SLOPE, STUDY, install, install_example, named
from tuning.cli import export as export_command
from tuning.cli import reproduce as reproduce_command
from tuning.exports.formats.registry import FORMATS, writer_of
from tuning.files.errors import InputError
from tuning.papers import PAPERS
from tuning.runs.folder import read_results
from tuning.runs.manifest import read_manifest
from tuning.runs.sealed import columns_of
from tuning.runs.workers import planner_of, run_chunk, spec_of
from tuning.study import plugins, registry
from tuning.study.base import resolved, study_hash
from tuning.study.loading import load_study, parse_study
from tuning.study.parts.catalog import SLOTS
from tuning.study.parts.springs import SPRINGS
from tuning.study.plugins import consenting
from tuning.study.scores import SCORES
from tuning.testing import check_part

SMALL = ("--set", "clock.duration=0.3", "--set", "scenarios={ train = 2, held_out = 2 }")
GRID = ("--grid", "estimator.torque.gain=50,100", "--scenarios", "2", *SMALL)


@pytest.fixture(autouse=True)
def _here(forgotten, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def beside(monkeypatch, tmp_path) -> Path:
    """The example's source on the path, not installed; returns a study that names its parts by their module."""
    monkeypatch.syspath_prepend(str(EXAMPLE / "src"))
    # Of the processes that commands start.
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}:{EXAMPLE / 'src'}")
    return named(STUDY, tmp_path / "named.toml")


def imported(name: str = "air_joint") -> bool:
    return name in sys.modules


@pytest.mark.contract
def test_parts_lists_every_slot_with_ranges_and_whose_it_is(vsajax, site):
    install_example(site)
    found = json.loads(vsajax("parts", "--json").out)
    assert found.keys() == {*SLOTS, "kinds", "scores", "formats", "papers"}
    for entries in found.values():
        assert all(told["summary"] and told["origin"] for told in entries.values())
    assert found["springs"]["linear"]["origin"] == "vsajax"
    air = found["springs"]["air"]
    assert (air["origin"], air["ref"]) == ("air-joint 0.1.0", "air_joint.tables:AirSpring")
    assert air["numbers"]["rate"] == {
        **{"low": 0, "high": None, "is_low_open": True, "is_high_open": False, "said": "0 < rate"}
    }
    text = vsajax("parts", "springs").out
    assert "stiffens beyond its knee.  [air-joint 0.1.0: air_joint.tables:AirSpring]" in text
    assert "0 < knee; 0.1 if left out" in text
    ended = vsajax("parts", "sprngs")
    assert ended.code == 2
    assert "SLOT: got 'sprngs': is none" in ended.err


@pytest.mark.contract
def test_an_installed_package_is_imported_when_a_study_uses_it_and_not_before(vsajax, site):
    install_example(site)
    assert vsajax("check", SEA).code == 0
    assert vsajax("check", SEA, "--set", "joint.spring.type=cubik").code == 2
    assert not imported()
    ended = vsajax("check", STUDY)
    assert (ended.code, ended.err) == (0, "")
    assert imported("air_joint.tables")
    assert not imported("air_joint.modules"), "what runs is not needed to check"


@pytest.mark.failure
def test_an_unknown_tag_is_told_with_its_neighbour_and_where_they_are_listed(vsajax, site):
    install_example(site)
    said = vsajax("check", SEA, "--set", "joint.spring={ type = 'aire', rate = 3.0 }").err
    assert "joint.spring.type: got 'aire'; allowed: 'linear', " in said
    assert "'lever', 'air'\n    fix: did you mean 'air'? `vsajax parts springs` lists them all" in said


@pytest.mark.failure
@pytest.mark.parametrize(
    "words",
    [
        ("check", "named.toml"),
        ("simulate", "named.toml"),
        ("estimate", "log.csv", "-c", "named.toml"),
        ("sweep", "named.toml", "-o", "run"),
        ("tune", "named.toml", "-o", "run"),
        ("montecarlo", "named.toml", "-o", "run"),
        ("compare", "named.toml", "shipped:sea", "-s", "named.toml", "-o", "run"),
        ("export", "named.toml", "--to", "toml", "-o", "out"),
        ("check", "choice.toml"),
        ("check", "grid.toml"),
        ("check", "kind.toml"),
        ("tune", "log.toml", "-o", "run"),
        ("check", "best.toml"),
        ("check", "shipped:sea", "--set", "joint.spring.type=air_joint.tables:AirSpring"),
        ("export", "shipped:sea", "--to", "air_joint.tables:write", "-o", "out"),
        ("reproduce", "air_joint.tables:reproduce"),
    ],
    ids=" ".join,
)
def test_no_file_imports_what_the_user_has_not_consented_to(vsajax, beside, words, tmp_path):
    sea = SEA.read_text()
    ref = "air_joint.tables:RootBasis"
    with consenting("air_joint"):
        best = json.loads(json.dumps(resolved(load_study(beside))))
    forget_modules()
    from tuning.study.base import to_toml

    log = '\n[recording]\nfile = "log.csv"\ntrain_until = 1.0\n'
    head = sea.split("[sweep]")[0].replace('type = "odd"', f'type = "{ref}"')
    choices = f'\n[tune.choices.basis]\nroot = {{ "estimator.basis" = {{ type = "{ref}" }} }}\n'
    files = {
        "choice.toml": sea + choices,
        "grid.toml": sea.replace("[sweep.grid]", f'[sweep.grid]\n"estimator.basis.type" = ["odd", "{ref}"]'),
        "kind.toml": sea.replace('kind = "sea"', 'kind = "air_joint.tables:KIND"'),
        "log.toml": head.replace("[scorer]", log + "[scorer]")
        + '[tune.parameters]\n"a" = { low = 1.0, high = 2.0 }\n',
        "best.toml": to_toml(best),
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    ended = vsajax(*words)
    assert (ended.code, ended.out) == (2, "")
    assert "nobody consented to importing air_joint.tables" in ended.err
    assert "--plugin air_joint, or VSAJAX_PLUGINS=air_joint, or modules" in ended.err
    assert not imported()


@pytest.mark.failure
def test_a_signal_map_and_a_log_import_nothing(vsajax, beside, tmp_path):
    (tmp_path / "map.toml").write_text(
        'schema_version = 1\nkind = "sea"\ntype = "air_joint.tables:X"\n[signals]\ntime = "air_joint.tables:X"\n'
    )
    (tmp_path / "log.csv").write_text("air_joint.tables:AirSpring,b\n1,2\n")
    assert vsajax("check", "map.toml", "--plugin", "air_joint").code == 2
    assert vsajax("init", "map", "log.csv").code in {0, 2}
    assert not imported()


@pytest.mark.contract
@pytest.mark.parametrize("way", ["option", "environment", "file", "part of a package"])
def test_consent_is_given_outside_the_study_in_three_ways(vsajax, beside, monkeypatch, tmp_path, way):
    words: tuple[str, ...] = ()
    if way == "option":
        words = ("--plugin", "air_joint")
    elif way == "part of a package":
        words = ("--plugin", "air_joint.tables")
    elif way == "environment":
        monkeypatch.setenv("VSAJAX_PLUGINS", "other, air_joint")
    else:
        path = tmp_path / "config" / "vsajax" / "plugins.toml"
        path.parent.mkdir(parents=True)
        path.write_text('modules = ["air_joint"]\n')
    ended = vsajax("check", beside, *words)
    assert (ended.code, ended.err) == (0, "")
    assert ("--plugin" in ended.out.splitlines()[-1]) == bool(words), "the next command is consented to as well"
    if words:
        assert vsajax("check", beside).code == 2, "consent ends with the command"


@pytest.mark.failure
def test_what_consents_to_nothing_is_told(vsajax, beside, tmp_path):
    assert "there is no module air_jiont" in vsajax("check", beside, "--plugin", "air_jiont").err
    assert "is no name of a module" in vsajax("check", beside, "--plugin", "a b").err
    path = tmp_path / "config" / "vsajax" / "plugins.toml"
    path.parent.mkdir(parents=True)
    path.write_text("modules = 3\n")
    assert f"{path}: is no list of modules" in vsajax("check", beside).err
    path.unlink()
    wrong = vsajax(
        "check", beside, "--plugin", "air_joint", "--set", "joint.spring.type=air_joint.tables:Nobody"
    ).err
    assert "air_joint.tables has no Nobody" in wrong
    wrong = vsajax("check", beside, "--plugin", "air_joint", "--set", "joint.spring.type=air_joint.tables:Ref").err
    assert "joint.spring.type: got 'air_joint.tables:Ref', which leads to" in wrong
    basis = "estimator.basis={ type = 'air_joint.tables:AirSpring', rate = 1.0 }"
    wrong = vsajax("check", beside, "--plugin", "air_joint", "--set", basis).err
    assert "the bases are subclasses of tuning.study.parts.estimators:BasisTable" in wrong


@pytest.mark.failure
def test_nobody_takes_a_tag_that_is_taken(vsajax, site):
    module = "from tuning.study.parts.springs import LinearSpring\n"
    points = {"vsajax.springs": {"linear": "acme:LinearSpring", "soft": "acme:LinearSpring"}}
    install(site, name="acme", points=points, module=module)
    install(site, name="other", points={"vsajax.springs": {"soft": "other:LinearSpring"}}, module=module)
    linear = ("check", SEA, "--set", "joint.spring={ type = 'linear', rate = 3.0 }")
    assert vsajax(*linear).code == 0
    assert not imported("acme")
    said = vsajax("check", SEA, "--set", "joint.spring={ type = 'soft', rate = 3.0 }").err
    assert "got 'soft', which both acme 1.0 and other 1.0 claim" in said
    listed = json.loads(vsajax("parts", "springs", "--json").out)["springs"]
    assert listed["linear"]["origin"] == "vsajax"
    assert listed["linear (refused)"]["problem"] == "the tag is taken by vsajax"
    with pytest.raises(InputError, match="'linear': is taken by vsajax"):
        SPRINGS.add("linear", SPRINGS.find("cubic"))
    SPRINGS.add("mine", SPRINGS.find("cubic"))
    with pytest.raises(InputError, match="'mine': is taken by"):
        SPRINGS.add("mine", SPRINGS.find("cubic"))
    added = load_study(SEA, ["joint.spring={ type = 'mine', linear = 1.0, cubic = 2.0 }"])
    assert type(added.joint.spring).__name__ == "CubicSpring"  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.failure
def test_nothing_is_taken_from_the_folder_in_which_a_command_runs(tmp_path):
    module = "open('trace', 'w').close()\nfrom tuning.study.parts.springs import LinearSpring\n"
    install(tmp_path, name="evil", points={"vsajax.springs": {"evil": "evil:LinearSpring"}}, module=module)

    def said(*words: object) -> str:
        # `python -m` puts the folder on the path; PYTHONPATH leads to the packages alone.
        command = [sys.executable, "-m", "vsajax", "check", str(SEA), *map(str, words)]
        ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert ended.returncode == 2, ended.stdout
        return ended.stderr

    assert "there is no module evil" in said("--plugin", "evil")
    assert "got 'evil'; allowed" in said("--set", "joint.spring={ type = 'evil', rate = 1.0 }")
    assert not (tmp_path / "trace").exists()


@pytest.mark.structure
def test_checking_a_study_with_a_plug_in_does_not_wait_for_jax(beside):
    code = (
        f"import sys; from tuning.cli.main import run; code = run(['check', {str(beside)!r}, '-q', '--plugin', "
        "'air_joint']); sys.exit(code or 3 * ('jax' in sys.modules))"
    )
    path = f"{ROOT}:{EXAMPLE / 'src'}"
    ended = subprocess.run(
        [sys.executable, "-c", code], env={"PYTHONPATH": path}, capture_output=True, text=True, check=False
    )
    assert ended.returncode == 0, ended.stderr


@pytest.mark.failure
def test_a_plug_in_that_cannot_be_imported_harms_those_alone_that_use_it(vsajax, site):
    points = {"vsajax.springs": {"broken": "broken:Spring"}, "vsajax.kinds": {"broken": "broken:KIND"}}
    install(site, name="broken", points=points, module="raise RuntimeError('no licence')\n")
    assert vsajax("check", SEA).code == 0
    said = vsajax("check", SEA, "--set", "joint.spring={ type = 'broken' }").err
    assert (
        "joint.spring.type: needs broken of broken 1.0, which cannot be imported (RuntimeError: no licence)"
        in said
    )
    assert "kind: needs broken of broken 1.0" in vsajax("check", SEA, "--set", "kind=broken").err
    listed = vsajax("parts", "springs")
    assert listed.code == 0
    assert "no licence" in listed.out


@pytest.mark.equivalence
def test_name_and_version_are_part_of_the_hash_if_and_only_if_something_foreign_is_used(site):
    own = study_hash(load_study(SEA))
    install_example(site)
    assert study_hash(load_study(SEA)) == own
    assert "plugins" not in resolved(load_study(SEA))
    study = load_study(STUDY)
    tables = resolved(study)
    assert tables["plugins"] == {
        f"air_joint.tables:{name}": {"name": "air-joint", "version": "0.1.0"}
        for name in ("AirSpring", "RootBasis", "StaticTorque")
    }
    assert parse_study(tables, "again") == study
    later = json.loads(json.dumps(tables).replace("0.1.0", "0.2.0"))
    with pytest.raises(InputError) as caught:
        parse_study(later, "best.toml")
    assert "best.toml: plugins.'air_joint.tables:" in str(caught.value)
    assert "says air-joint 0.2.0; here is air-joint 0.1.0\n    fix: install air-joint 0.2.0, or remove" in str(
        caught.value
    )
    with pytest.raises(InputError, match="plugins: got 3"):
        parse_study(tables | {"plugins": 3}, "best.toml")
    missing = json.loads(json.dumps(tables).replace("air-joint", "water-joint").replace('"air"', '"water"'))
    with pytest.raises(InputError) as caught:
        parse_study(missing, "best.toml")
    assert str(caught.value).startswith("best.toml: plugins: needs water-joint 0.1.0, which is not installed")
    # What a choice or a grid brings in counts as much as what the study has itself.
    choices = 'tune.choices={ basis = { root = { "estimator.basis" = { type = "root" } }, odd = {} } }'
    assert list(resolved(load_study(SEA, [choices]))["plugins"]) == ["air_joint.tables:RootBasis"]


@pytest.mark.equivalence
def test_a_package_without_entry_points_is_known_by_what_its_installer_wrote(site):
    module = "from tuning.study.parts.springs import LinearSpring\n"
    install(site, name="acme", version="3.1", points={}, module=module)
    with consenting("acme"):
        study = load_study(SEA, ["joint.spring={ type = 'acme:LinearSpring', rate = 3.0 }"])
    assert resolved(study)["plugins"] == {"acme:LinearSpring": {"name": "acme", "version": "3.1"}}


@pytest.mark.equivalence
def test_another_version_is_another_study(site, monkeypatch):
    install_example(site)
    before = study_hash(load_study(STUDY))
    install_example(site, version="0.2.0")
    registry._LOADED.clear()
    for slot in SLOTS.values():
        slot._added.clear()
    plugins._installed.cache_clear()
    assert study_hash(load_study(STUDY)) != before


@pytest.fixture
def swept(vsajax, beside) -> Path:
    """A small sweep of the example, which is not installed."""
    ended = vsajax("sweep", beside, "-o", "run", *GRID, "--plugin", "air_joint")
    assert ended.code == 0, ended.err
    return Path("run")


@pytest.mark.contract
def test_a_run_says_what_it_used_and_its_workers_refuse_what_they_lack(vsajax, beside, swept, monkeypatch):
    manifest = read_manifest(swept / "manifest.json")
    (version,) = {record["version"] for record in manifest["study"]["plugins"].values()}
    assert version.startswith("source ")
    assert manifest["versions"]["air_joint"] == version
    best = tomllib.loads((swept / "best.toml").read_text())
    assert best["plugins"] == manifest["study"]["plugins"]
    assert best["provenance"]["versions"]["air_joint"] == version
    # The run folder itself consents to nothing.
    forget_modules()
    said = vsajax("report", swept).err
    assert "nobody consented to importing air_joint.tables" in said
    assert not imported()
    assert vsajax("sweep", beside, "-o", "run", *GRID, "--plugin", "air_joint", "--resume").code == 0
    with consenting("air_joint"):
        spec = spec_of(manifest)
    # A worker has the modules that were consented to from who sends it work.
    planner_of.cache_clear()
    assert len(run_chunk(spec, manifest["chunks"][0])["msrep"]) > 0
    planner_of.cache_clear()
    older = json.dumps(
        json.loads(spec) | {"study": json.loads(json.dumps(manifest["study"]).replace(version, "0.0"))}
    )
    with pytest.raises(InputError, match=r"worker on .*: needs air_joint 0\.0 .*; here is air_joint source"):
        run_chunk(older, manifest["chunks"][0])
    forget_modules()
    monkeypatch.setattr(sys, "path", [entry for entry in sys.path if entry != str(EXAMPLE / "src")])
    with pytest.raises(InputError, match=r"worker on .*: needs air_joint source .* which cannot be imported"):
        run_chunk(spec, manifest["chunks"][0])


@pytest.mark.slow(
    twin=(
        "test_a_run_says_what_it_used_and_its_workers_refuse_what_they_lack",
        "tests/tuning/test_executors.py::test_workers_give_the_bytes_of_a_run_in_one_process",
    )
)
@pytest.mark.equivalence
def test_a_dask_worker_computes_with_a_plug_in(vsajax, beside, swept):
    ended = vsajax("sweep", beside, "-o", "dask", *GRID, "--plugin", "air_joint", "--workers", "1")
    assert ended.code == 0, ended.err
    ours, theirs = (columns_of(read_results(folder)) for folder in (swept, Path("dask")))
    assert ours.keys() == theirs.keys()
    for name, column in ours.items():
        np.testing.assert_array_equal(column, theirs[name], err_msg=name)


@pytest.mark.contract
def test_what_uses_a_plug_in_is_simulated_and_exported(vsajax, beside, tmp_path):
    consent = ("--plugin", "air_joint")
    assert vsajax("simulate", beside, "-o", "r.parquet", *SMALL, *consent).code == 0
    ended = vsajax("estimate", "r.parquet", "-c", beside, "-o", "e.parquet", *consent)
    assert ended.code == 0, ended.err
    ended = vsajax("export", beside, "--to", "c99", "-o", "c", "--duration", "0.2", "--check", *consent)
    assert ended.code == 0, ended.out + ended.err
    written = "".join(path.read_text() for path in (tmp_path / "c").glob("*.[ch]"))
    assert "import" not in written
    slope = named(SLOPE, tmp_path / "slope.toml")
    ended = vsajax("export", slope, "--to", "json", "-o", "json", "--duration", "0.2", *consent)
    assert ended.code == 0, ended.out + ended.err
    assert json.loads((tmp_path / "json" / "manifest.json").read_text())["versions"]["air_joint"]


TABLES = {
    "springs": ("AirSpring", {"rate": 60.0}),
    "bases": ("RootBasis", {"terms": 3}),
    "torques": ("StaticTorque", {"gain": 100.0, "motor_damping": 1e-3}),
    "estimators": ("SlopeEstimator", {"memory": 0.3}),
}


@pytest.mark.contract
@pytest.mark.parametrize("slot", TABLES)
def test_the_example_keeps_the_contract(beside, slot):
    name, table = TABLES[slot]
    check_part(getattr(import_module("air_joint.tables"), name), table, slot=slot)


@pytest.mark.failure
@pytest.mark.parametrize(
    ("change", "slot", "said"),
    [
        (("modules", "1.0 + 2.0 * u * u", "1.0 + 3.0 * u * u"), "springs", "stiffness is not the slope of torque"),
        (("modules", "deflection * jnp.sqrt(1.0", "deflection + jnp.sqrt(1.0"), "springs", "stiffness is not"),
        (("modules", "default=0.1)", "default=0.2)"), "springs", "is not what its class leaves out"),
        (("modules", "converter=as_leaf)", "converter=float)"), "springs", "use the converter"),
        (("tables", "knee: Positive = 0.1", "bend: Positive = 0.1"), "springs", "its class"),
        (
            ("tables", "knee: Positive = 0.1", "knee: Positive = -0.1"),
            "springs",
            "its default -0.1 is not allowed",
        ),
        (("tables", "from __future__", "import jax\nfrom __future__"), "springs", "imports jax"),
        (("tables", "return self.terms", "return self.terms + 1"), "bases", "the table has size 4"),
        (
            ("modules", "* (deflection - mean), known", "* (deflection - mean), ~known"),
            "estimators",
            "after one sample",
        ),
        (("tables", '"elastic_torque"', '"true_stiffness"'), "estimators", "the table needs"),
    ],
)
def test_a_part_that_breaks_the_contract_is_told(site, change, slot, said, monkeypatch):
    install_example(site)
    module, old, new = change
    path = site / "air_joint" / f"{module}.py"
    text = path.read_text()
    assert old in text
    if old == "from __future__":
        text, old, new = text.replace(f"{old} import annotations\n", ""), "from tuning", "import jax\nfrom tuning"
    path.write_text(text.replace(old, new, 1 if module == "tables" else -1))
    from tuning.testing import contract

    contract._check_module.cache_clear()
    name, table = TABLES[slot]
    try:
        with pytest.raises(AssertionError, match=said):
            check_part(getattr(import_module("air_joint.tables"), name), table, slot=slot)
    finally:
        contract._check_module.cache_clear()


ACME = """
from tuning.files.kinds import STUDY
from tuning.papers.rows import Report, Row
from tuning.study.kinds import Kind
from tuning.study.refs import Ref
from tuning.study.scores import Score

_HERE = "tuning.kinds.estimation"
KIND = Kind("?", STUDY, Ref(f"{_HERE}.study:SeaStudy"), problem=Ref(f"{_HERE}.problem:EstimationProblem"))
STROKE = Score("?", "stroke", "m", is_objective=True)


def write(subject):
    'Lines of text.'


def reproduce(folder):
    'A paper of ours.'
    return Report("A paper of ours", [Row("one", 1.0, 1.0, "", 0.5, 1.5)], [])
"""


@pytest.mark.contract
def test_kinds_scores_formats_and_papers_have_the_same_door(vsajax, site):
    tags = {"kinds": "KIND", "scores": "STROKE", "formats": "write", "papers": "reproduce"}
    points = {f"vsajax.{name}": {f"acme_{name}": f"acme:{entry}"} for name, entry in tags.items()}
    install(site, name="acme", points=points, module=ACME)
    own = vsajax("check", SEA, "--json").out
    ended = vsajax("check", SEA, "--json", "--set", "kind=acme_kinds")
    assert (ended.code, ended.err) == (0, "")
    assert json.loads(ended.out)["hash"] != json.loads(own)["hash"]
    assert json.loads(ended.out)["study"]["plugins"] == {"acme:KIND": {"name": "acme", "version": "1.0"}}
    assert SCORES["acme_scores"].title == "stroke [m]"
    said = vsajax("check", SEA, "--set", "tune.objective=acme_scores").err
    assert "tune.objective: got 'acme_scores', which a study of kind 'sea' does not score" in said
    assert (
        "tune.objective: got 'acme_scorse'; input should be 'msrep'"
        in vsajax("check", SEA, "--set", "tune.objective=acme_scorse").err
    )
    assert writer_of("acme_formats").__doc__ == "Lines of text."
    assert vsajax("export", SEA, "--to", "acme_formatt", "-o", "x").code == 2
    ended = vsajax("reproduce", "acme_papers")
    assert (ended.code, ended.err) == (0, "")
    assert "A paper of ours" in ended.out
    for name in tags:
        assert vsajax("parts", name).out.count("[acme 1.0: acme:") == 1


@pytest.mark.structure
def test_commands_know_the_names_of_vsajax_when_they_are_asked_for():
    code = "import sys, tuning.cli.export, tuning.cli.reproduce; sys.exit('pydantic' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
    (to,) = (one for one in export_command.export.params if one.name == "target")
    (paper,) = (one for one in reproduce_command.reproduce.params if one.name == "paper")
    assert list(to.type.choices) == list(FORMATS.own())
    assert list(paper.type.choices) == [*PAPERS.own(), "all"]
