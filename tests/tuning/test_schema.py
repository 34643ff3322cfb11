"""What a study with mistakes says: all of them, each with its path and the way out."""

from __future__ import annotations

import pytest

from tests.tuning.builders import PRIOR, SEA, SERIAL
from tuning.files.errors import InputError
from tuning.study.loading import load_config, load_study


def said(*settings: str, study=SERIAL) -> str:
    """Return what loading a study with some settings complains of."""
    with pytest.raises(InputError) as caught:
        load_study(study, settings)
    assert all(mistake.place.startswith((str(study), "--set")) for mistake in caught.value.mistakes)
    return str(caught.value)


def said_of(path) -> str:
    """Return what loading a file complains of."""
    with pytest.raises(InputError) as caught:
        load_config(path)
    return str(caught.value)


MISTAKES = [
    ("joint.link.inertia=-0.1", ["joint.link.inertia", "got -0.1", "greater than 0"]),
    ("joint.link.inertia=0", ["joint.link.inertia", "got 0", "greater than 0"]),
    ("joint.link.damping=-1.0", ["joint.link.damping", "greater than or equal to 0"]),
    ("joint.motor.gear_ratio=0.5", ["joint.motor.gear_ratio", "greater than or equal to 1"]),
    ("joint.link.mass=1.0", ["joint.link.mass", "unknown key", "allowed here: damping, friction, gravity"]),
    ("joint.link.inertai=1.0", ["joint.link.inertai", "unknown key", "did you mean inertia?"]),
    ("estimater=1", ["estimater", "unknown key", "did you mean estimator?"]),
    ("joint.link=3", ["joint.link", "got 3", "needs a table", "[joint.link]"]),
    ("joint=3", ["joint", "needs a table"]),
    ("joint.motor.damping=fast", ["joint.motor.damping", "got 'fast'", "valid number"]),
    ("joint.motor.damping='0.1'", ["joint.motor.damping", "got '0.1'", "valid number"]),
    ("joint.motor.damping=true", ["joint.motor.damping", "got True", "valid number"]),
    ("joint.motor.damping=inf", ["joint.motor.damping", "got inf", "finite"]),
    ("excitation.motor.amplitude=nan", ["excitation.motor.amplitude", "got nan", "finite"]),
    ("estimator.basis.deflection_terms=0", ["estimator.basis.deflection_terms", "got 0"]),
    ("estimator.basis.deflection_terms=2.5", ["estimator.basis.deflection_terms", "valid integer"]),
    ("estimator.basis.deflection_offset=1", ["estimator.basis.deflection_offset", "valid boolean"]),
    ("estimator.deflection=smooth", ["estimator.deflection", "'smooth'", "'filtered', 'raw' or 'measured'"]),
    (f"{PRIOR}=0", [PRIOR, "got 0", "greater than 0"]),
    ("estimator.fit.law={type='enhanced', constant=0}", ["estimator.fit.law.constant", "greater than 0"]),
    ("estimator.fit.law={type='enhanced', constant=-1e-20}", ["estimator.fit.law.constant", "-1e-20"]),
    ("estimator.fit.law={type='enhanced'}", ["estimator.fit.law.constant", "is missing"]),
    ("estimator.fit.law={type='constant', factor=1.5}", ["estimator.fit.law.factor", "less than or equal to 1"]),
    ("estimator.fit.law={constant=1.0}", ["estimator.fit.law.type", "is missing", "which kind of table"]),
    ("estimator.fit.law={type='magic'}", ["estimator.fit.law.type", "'magic'", "'unit', 'enhanced'"]),
    ("estimator.torque={type='laser'}", ["estimator.torque.type", "'laser'", "'sensor', 'model', 'residual'"]),
    ("estimator.basis={type='legendre', lower=1, upper=0}", ["estimator.basis", "lower must be below upper"]),
    ("joint.spring={type='linear'}", ["joint.spring.rate", "is missing"]),
    ("joint.preset=lwr", ["joint.preset", "'lwr'", "allowed: awas"]),
    ("excitation.motor={type='noise', std=1.0, low=3, high=2}", ["excitation.motor", "low must be below high"]),
    (
        "excitation.motor={type='multisine', amplitudes=[1.0], frequencies=[1.0, 2.0], phases=[0.0]}",
        ["excitation.motor", "one length", "1, 2 and 1"],
    ),
    (
        "excitation.motor={type='multisine', amplitudes=[1.0], frequencies=[-1.0], phases=[0.0]}",
        ["excitation.motor.frequencies.0", "got -1.0"],
    ),
    ("clock.duration=1e-3", ["clock", "at least two sample times", "0.001 s"]),
    ("clock.sample_time=0", ["clock.sample_time", "greater than 0"]),
    ("schema_version=2", ["schema_version", "got 2", "1"]),
    ("kind=arm", ["kind", "'arm'", "allowed: serial, sea"]),
    ("seed=-1", ["seed", "got -1"]),
    ("scenarios.train=0", ["scenarios.train", "greater than or equal to 1"]),
    ("seed=9223372036854775808", ["seed", "less than or equal to 9223372036854775807"]),
]


@pytest.mark.failure
@pytest.mark.parametrize(("setting", "words"), MISTAKES, ids=[setting for setting, _ in MISTAKES])
def test_a_mistake_is_named_with_its_path_and_what_is_allowed(setting, words):
    text = said(setting)
    assert text.startswith(f"{SERIAL}: {words[0]}:")
    for word in words:
        assert word in text


@pytest.mark.failure
def test_a_signal_that_the_estimator_needs_must_be_measured():
    text = said("sensing={ link_position={} }")
    for name in ("motor_position", "motor_torque", "setpoint_position"):
        assert f"sensing.{name}: is missing, but the estimator needs this signal" in text
    assert "sensing.link_position" not in text
    assert "add a [sensing.motor_torque] table" in text


@pytest.mark.failure
def test_an_objective_that_counts_no_sample_is_refused():
    text = said("tune.objective=msrep_settled", "scorer.warm_up=10.0")
    assert "scorer.warm_up: got 10.0 s; no sample of 10.0 s is left for tune.objective" in text
    assert load_study(SERIAL, ["scorer.warm_up=10.0"]).tune.objective == "msrep"


@pytest.mark.failure
def test_all_mistakes_of_a_file_come_together(tmp_path):
    wrong = {
        "inertia = 0.05 #": "inertia = -1.0 #",
        "gravity = 1.5 ": "gravty = 1.5 ",
        'type = "cubic"': 'type = "cubik"',
        "sample_time = 2e-3": 'sample_time = "fast"',
        "prior_scale = 1e4": "prior_scale = 0.0",
        "max_relative_std = 0.05": "max_relative_std = nan",
    }
    text = SEA.read_text()
    for old, new in wrong.items():
        assert text.count(old) == 1
        text = text.replace(old, new)
    path = tmp_path / "study.toml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        load_study(path)
    assert sorted(mistake.place.removeprefix(f"{path}: ") for mistake in caught.value.mistakes) == [
        "clock.sample_time",
        "estimator.fit.prior_scale",
        "estimator.gate.max_relative_std",
        "joint.link.gravty",
        "joint.link.inertia",
        "joint.spring.type",
    ]
    assert str(caught.value).count("\n    fix: ") == 2
    assert "fix: did you mean 'cubic'? `vsajax parts springs` lists them all" in str(caught.value)


@pytest.mark.failure
@pytest.mark.parametrize(
    "table", ["joint", "joint.link", "joint.spring", "sensing", "clock", "estimator", "estimator.fit"]
)
def test_a_missing_table_is_named(tmp_path, table):
    kept, skips = [], False
    for line in SEA.read_text().splitlines():
        if line.startswith("["):
            skips = f"{line.strip('[]')}.".startswith(f"{table}.")
        if not skips:
            kept.append(line)
    path = tmp_path / "study.toml"
    path.write_text("\n".join(kept))
    assert f"{path}: {table}: is missing\n    fix: add it" in said_of(path)


@pytest.mark.failure
@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["is empty", "vsajax init"]),
        (" \n\n", ["is empty"]),
        ('kind = "sea"\nseed = = 3\n', ["is not valid TOML", "line 2, column 8"]),
        ("seed = 1\nseed = 2\n", ["is not valid TOML", "line 2"]),
        ('kind = "sea\n', ["is not valid TOML", "line 1"]),
        ("seed = 1\n", ["kind: is missing", "allowed: serial, sea"]),
        ("kind = 3\n", ["kind: got 3", "allowed: serial, sea"]),
    ],
)
def test_a_file_that_holds_no_study_is_named(tmp_path, text, words):
    path = tmp_path / "study.toml"
    path.write_text(text)
    message = said_of(path)
    assert message.startswith(str(path))
    for word in words:
        assert word in message


@pytest.mark.failure
def test_a_file_that_cannot_be_read_is_named(tmp_path):
    (tmp_path / "study.toml").write_bytes(b'name = "\xff"\n')
    assert "study.toml: is not UTF-8 text (byte 8)" in said_of(tmp_path / "study.toml")
    assert f"{tmp_path}: is a directory\n    fix: name a file in it" in said_of(tmp_path)
    assert f"did you mean {tmp_path / 'study.toml'}?" in said_of(tmp_path / "studi.toml")
    assert "study.toml/x: cannot be read (Not a directory)" in said_of(tmp_path / "study.toml" / "x")


RANGES = [
    ("[1.0, 2.0]", None),
    ("{ low = 0.1, high = 10.0, points = 3 }", None),
    ("[]", "needs at least one value"),
    ("[1.0, 1.0]", "each only once"),
    ("[1.0, -1.0]", "reaches -1, which is not allowed there: got -1.0; input should be greater than 0"),
    ("{ low = 0.1, high = 10.0 }", "needs either a list of values, or low, high and points"),
    ("{ low = 10.0, high = 0.1, points = 3 }", "low must be below high; got 10.0 and 0.1"),
    ("{ low = -1.0, high = 1.0, points = 3 }", "a log range must be positive; got low = -1.0"),
    ("{ low = -1.0, high = 1.0, points = 3, scale = 'linear' }", "reaches -1, which is not allowed there"),
    ("{ low = 0.1, high = 10.0, points = 3, scale = 'cubic' }", "got 'cubic'"),
    ("3", "got 3; needs a table"),
]


@pytest.mark.failure
@pytest.mark.parametrize(("axis", "problem"), RANGES)
def test_a_range_of_a_grid_is_held_against_the_number_that_it_replaces(axis, problem):
    setting = f'sweep.grid={{ "{PRIOR}" = {axis} }}'
    if problem is None:
        assert load_study(SERIAL, [setting]).sweep.grid[PRIOR].grid()[0] > 0.0
    else:
        text = said(setting)
        assert "sweep.grid." in text
        assert PRIOR in text
        assert problem in text


@pytest.mark.failure
@pytest.mark.parametrize("table", ["sweep.grid", "tune.parameters"])
@pytest.mark.parametrize(
    ("path", "fix"),
    [
        ("estimator.fit.prior_scle", "did you mean estimator.fit.prior_scale"),
        ("estimator.basis.deflection_scal", "did you mean estimator.basis.deflection_scale"),
        ("zzz", "`vsajax check STUDY` lists every number"),
    ],
)
def test_a_path_that_leads_to_no_number_is_named(table, path, fix):
    text = said(f'{table}={{ "{path}" = {{ low = 1.0, high = 2.0, points = 2 }} }}')
    assert f"{table}.{path!r}: leads to no number of the study" in text
    assert fix in text


@pytest.mark.failure
def test_bounds_of_tuning_are_held_against_the_number_that_they_replace():
    text = said(f"tune.parameters={{ '{PRIOR}' = {{ low = -1.0, high = 2.0, scale = 'linear' }} }}")
    assert f"tune.parameters.'{PRIOR}': reaches -1, which is not allowed there" in text
    text = said("tune.parameters={ 'joint.motor.gear_ratio' = { low = 0.5, high = 2.0 } }")
    assert "reaches 0.5" in text
