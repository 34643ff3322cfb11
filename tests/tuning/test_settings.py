"""`--set`, presets, and how they are laid over a file."""

from __future__ import annotations

import pytest

from tests.tuning.builders import ANTAGONISTIC, SEA, SERIAL
from tuning.files.errors import InputError
from tuning.files.shipped import choose
from tuning.files.toml import read_toml
from tuning.study.base import resolved, study_hash
from tuning.study.loading import load_config, load_study


def said(*settings: str) -> str:
    with pytest.raises(InputError) as caught:
        load_study(SERIAL, settings)
    return str(caught.value)


@pytest.mark.parametrize(
    ("setting", "path", "value"),
    [
        ("seed=7", "seed", 7),
        ("name=other", "name", "other"),
        ('name="seven 7"', "name", "seven 7"),
        ("joint.link.inertia=1", "joint.link.inertia", 1.0),
        ("joint.link.inertia = 2.5e-1", "joint.link.inertia", 0.25),
        ("joint.link.gravity=-9", "joint.link.gravity", -9.0),
        ("clock.jitter_std=1e-4", "clock.jitter_std", 1e-4),
        ("estimator.basis.torque_bias=true", "estimator.basis.torque_bias", True),
        ("estimator.fit.law={type='forgetting', forgetting=0.99}", "estimator.fit.law.forgetting", 0.99),
        ("sensing.motor_torque={}", "sensing.motor_torque", {}),
        ("sweep.grid={}", "sweep.grid", {}),
    ],
)
def test_a_setting_replaces_a_value(setting, path, value):
    found = resolved(load_study(SERIAL, [setting]))
    for key in path.split("."):
        found = found[key]
    assert found == value
    assert type(found) is type(value)


def test_the_last_of_two_settings_holds():
    assert load_study(SERIAL, ["seed=1", "seed=2"]).seed == 2


@pytest.mark.failure
@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("seed", ["--set seed:", "is not of the form a.b=value", "e.g. --set"]),
        ("=3", ["--set =3:", "is not of the form a.b=value"]),
        ("seed.x=3", ["--set seed.x=3:", "leads through a value that is not a table"]),
        ("sweep..grid=3", ["sweep.", "unknown key"]),
        ('sweep.grid."a.b=3', ["is not of the form a.b=value", "for a key with a dot in it"]),
        ("joint.linc.inertia=3", ["joint.linc", "did you mean link?"]),
    ],
)
def test_a_setting_that_leads_nowhere_is_named(setting, words):
    text = said(setting)
    for word in words:
        assert word in text


def test_a_preset_gives_every_table_of_the_joint():
    preset = read_toml(choose("joints", "awas", "here"))
    joint = resolved(load_study(SERIAL))["joint"]
    assert {key: joint[key] for key in preset} == preset


def test_a_preset_is_overridden_number_by_number():
    plain = resolved(load_study(SERIAL))["joint"]
    other = resolved(load_study(SERIAL, ["joint.link.inertia=0.2", "joint.motor.friction={torque=0.1}"]))["joint"]
    assert other["link"] == plain["link"] | {"inertia": 0.2}
    assert other["motor"] == plain["motor"] | {"friction": {"torque": 0.1, "velocity_scale": 0.05}}
    assert other["spring"] == plain["spring"]


def test_a_spring_of_another_type_replaces_the_presets_and_one_of_the_same_adds_to_it():
    other = load_study(SERIAL, ["joint.spring={type='linear', rate=100.0}"])
    assert resolved(other)["joint"]["spring"] == {"type": "linear", "rate": 100.0}
    same = resolved(load_study(SERIAL, ["joint.spring={type='lever', arm=0.2}"]))["joint"]["spring"]
    assert same == resolved(load_study(SERIAL))["joint"]["spring"] | {"arm": 0.2}


def test_a_preset_is_as_good_as_its_tables(tmp_path):
    preset = choose("joints", "awas", "here").read_text()
    tables = preset.replace("[", "[joint.").replace("setpoint_start", "joint.setpoint_start")
    tables = tables.replace("\nstart =", "\njoint.start =")
    text = SERIAL.read_text().replace('[joint]\npreset = "awas"\n', "")
    head, _, rest = text.partition("# The joint.")
    (tmp_path / "study.toml").write_text(f"{head}{tables}\n# {rest}")
    assert study_hash(load_study(tmp_path / "study.toml")) == study_hash(load_study(SERIAL))


def test_an_estimator_without_a_joint_is_a_configuration(tmp_path):
    text = SEA.read_text()
    start, end = text.index("[estimator]"), text.index("[scorer]")
    path = tmp_path / "estimator.toml"
    path.write_text(f'schema_version = 1\nkind = "sea"\n{text[start:end]}')
    config = load_config(path)
    assert config.estimator == load_study(SEA).estimator
    with pytest.raises(InputError, match="is an estimator configuration, not a study of a simulated joint"):
        load_study(path)


WINDOW = ("estimator.side.window=0.3", "estimator.side.longest_window=0.3")


@pytest.mark.parametrize("quote", ['"', "'"])
def test_a_key_with_dots_in_it_is_quoted(quote):
    path = f"sweep.grid.{quote}estimator.side.window{quote}"
    high = [f"{table}.{quote}estimator.side.window{quote}.high=0.3" for table in ("sweep.grid", "tune.parameters")]
    study = load_study(ANTAGONISTIC, [*WINDOW, *high, f"{path}.points = 3"])
    axis = study.sweep.grid["estimator.side.window"]
    assert (axis.low, axis.high, axis.points) == (0.05, 0.3, 3)
    assert study.tune.parameters["estimator.side.window"].high == 0.3


def test_a_search_that_is_not_made_need_not_fit():
    with pytest.raises(InputError, match="reaches 2, which is not allowed there"):
        load_study(ANTAGONISTIC, WINDOW)
    study = load_study(ANTAGONISTIC, WINDOW, unused=("sweep", "tune"))
    assert (study.sweep.grid, study.tune.parameters) == ({}, {})
    with pytest.raises(InputError, match="reaches 2, which is not allowed there") as caught:
        load_study(ANTAGONISTIC, WINDOW, unused=["sweep"])
    assert {mistake.place.partition(":")[2] for mistake in caught.value.mistakes} == {
        " tune.parameters.'estimator.side.window'"
    }


def test_a_search_that_fits_stays_part_of_the_study_and_its_hash():
    assert study_hash(load_study(SERIAL, unused=("sweep", "tune"))) == study_hash(load_study(SERIAL))


@pytest.mark.failure
def test_other_mistakes_are_told_without_those_of_a_search_that_is_not_made():
    with pytest.raises(InputError) as caught:
        load_study(ANTAGONISTIC, [*WINDOW, "estimator.side.sample_time=0.002"], unused=("sweep", "tune"))
    assert [mistake.place.partition(": ")[2] for mistake in caught.value.mistakes] == [
        "estimator.side.sample_time"
    ]
