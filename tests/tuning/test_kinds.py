"""Every shipped file is recognised: `check` reads it, and whatever takes another kind says what it is."""

from __future__ import annotations

import json
import re

import pytest

from tuning.files.errors import InputError
from tuning.files.kinds import FILE_KINDS, ONLY_IN_STUDIES, kind_of
from tuning.files.shipped import CONFIGS, shipped_files
from tuning.files.toml import read_toml
from tuning.kinds.arm.study import load_arm_study
from tuning.kinds.damping.study import DampingStudy
from tuning.kinds.estimation.study import EstimationStudy
from tuning.logs.signal_map import read_signal_map
from tuning.study.base import Config
from tuning.study.loading import load_config, load_study

LOADERS = {
    "a study of a simulated joint": load_study,
    "an estimator configuration": load_config,
    "a signal map": read_signal_map,
    "a study of an arm": load_arm_study,
}
SCORED = {"a study of a simulated joint", "a study of a log", "a study of an arm"}
"""What every command that scores takes."""
FOLDERS = {
    "arms": "an arm preset",
    "contests": "a study of a simulated joint",
    "joints": "a joint preset",
    "log_studies": "a study of a log",
    "logs": "a signal map",
    "studies": "a study of a simulated joint",
}


def _expected(name: str) -> str:
    folder, stem = name.split("/")
    if folder == "tuned":
        return "a study of a simulated joint" if stem.startswith("damping") else "an estimator configuration"
    return "a study of an arm" if stem == "arm" else FOLDERS[folder]


@pytest.mark.parametrize("name", shipped_files())
def test_every_shipped_file_is_recognised_and_checked(vsajax, name):
    path = shipped_files()[name]
    kind = kind_of(read_toml(path))
    assert kind is not None
    assert kind.name == _expected(name)
    ended = vsajax("check", path)
    assert (ended.code, ended.err) == (0, "")
    assert f"valid {kind.label}, hash" in ended.out.splitlines()[-2]


@pytest.mark.failure
@pytest.mark.parametrize("wanted", LOADERS)
@pytest.mark.parametrize("name", shipped_files())
def test_a_file_of_another_kind_is_refused_by_what_it_is(name, wanted):
    path, is_of = shipped_files()[name], _expected(name)
    if LOADERS[wanted] in (load_study, load_config) and is_of in SCORED:
        LOADERS[wanted](path)
        return
    if is_of == wanted:
        LOADERS[wanted](path)
        return
    with pytest.raises(InputError) as refused:
        LOADERS[wanted](path)
    (mistake,) = refused.value.mistakes
    assert str(mistake).startswith(f"{path}: is {is_of}, not {wanted}\n    fix: ")


@pytest.mark.failure
def test_every_kind_says_what_takes_it():
    assert len({kind.use for kind in FILE_KINDS}) == len(FILE_KINDS)
    for kind in FILE_KINDS:
        assert "vsajax " in kind.use or "a study names" in kind.use


@pytest.mark.structure
def test_the_keys_that_make_a_study_are_those_of_its_tables():
    fields = {"joint", *EstimationStudy.model_fields, *DampingStudy.model_fields}
    assert fields - set(Config.model_fields) == ONLY_IN_STUDIES


@pytest.mark.cli
@pytest.mark.failure
def test_what_is_no_toml_at_all_is_told_by_its_name(vsajax, tmp_path):
    log, robot, run = tmp_path / "log.parquet", tmp_path / "robot.urdf", tmp_path / "run"
    log.write_bytes(b"PAR1\xff\xfe")
    robot.write_text("<robot name='r'/>")
    run.mkdir()
    (run / "best.toml").touch()
    assert f"vsajax estimate {log} -c CONFIG" in vsajax("check", log).err
    assert f'urdf = "{robot}" in [arm]' in vsajax("sweep", robot, "-o", tmp_path / "s").err
    assert f"{run}: is a directory\n    fix: did you mean {run / 'best.toml'}?" in vsajax("check", run).err


@pytest.mark.cli
def test_a_shipped_file_goes_by_its_name_wherever_a_path_does(vsajax):
    assert "# shipped:serial: valid study" in vsajax("check", "shipped:serial").out
    assert "# shipped:logs/hebi: valid signal map" in vsajax("check", "shipped:logs/hebi").out
    assert "shipped:hebi: is a signal map" in vsajax("simulate", "shipped:hebi").err
    assert read_signal_map(CONFIGS / "logs" / "hebi.toml")


@pytest.mark.cli
@pytest.mark.failure
@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("seriel", ["shipped:seriel: no such file ships with vsajax", "did you mean shipped:serial?", "--list"]),
        ("quanser_flex", ["names several", "shipped:log_studies/quanser_flex, shipped:logs/quanser_flex"]),
        ("", ["no such file ships with vsajax"]),
        ("../secret", ["no such file ships with vsajax"]),
    ],
)
def test_a_name_that_no_shipped_file_has_is_refused(vsajax, name, words):
    ended = vsajax("check", f"shipped:{name}")
    assert ended.code == 2
    for word in words:
        assert word in ended.err


@pytest.mark.cli
def test_init_lists_every_shipped_file_and_copies_any(vsajax, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    listed = json.loads(vsajax("init", "--list", "--json").out)["shipped"]
    assert set(listed) == set(shipped_files())
    assert len({*listed.values()}) == len(listed)
    assert all(name in vsajax("init", "--list").out for name in listed)
    assert vsajax("init", "logs/hebi").code == 0
    first, _, rest = (tmp_path / "hebi.toml").read_bytes().partition(b"\n")
    assert (first, rest) == (b"#:schema map.schema.json", shipped_files()["logs/hebi"].read_bytes())
    assert vsajax("init", "joints/awas").code == 0
    assert (tmp_path / "awas.toml").read_bytes() == shipped_files()["joints/awas"].read_bytes()


@pytest.mark.structure
def test_nothing_that_ships_names_a_file_of_a_checkout():
    told = [*CONFIGS.rglob("*.toml"), *(CONFIGS.parent / "tuning").rglob("*.py")]
    said = [p for p in told if re.search(r"(configs|tests)/[\w-]+[/.]", p.read_text(encoding="utf-8"))]
    assert said == []
