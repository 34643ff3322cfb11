"""A study as data: its hash, its forms on disk, and its numbers as leaves of the built bench."""

from __future__ import annotations

import copy
import json
import math
import tomllib

import equinox as eqx
import jax
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.tuning.builders import EXAMPLES, PRIOR, SERIAL, TUNED
from tuning.files.shipped import choose
from tuning.files.toml import read_toml, validate
from tuning.kinds.damping.deployable import deployable_of
from tuning.kinds.damping.problem import DampingProblem
from tuning.kinds.damping.study import DampingStudy
from tuning.kinds.estimation.problem import EstimationProblem
from tuning.problem.build import (
    build,
    build_estimator,
    number,
    with_leaves,
)
from tuning.study.base import resolved, study_hash, to_toml
from tuning.study.loading import load_config, load_study, parse_study, with_numbers
from tuning.study.parts.joints import SerialJoint
from tuning.study.paths import numeric_paths
from vsajax.plants import awas

NUMBERS = numeric_paths(load_study(SERIAL))
each_example = pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)


def built(study):
    """Return what a study simulates."""
    return (DampingProblem if isinstance(study, DampingStudy) else EstimationProblem)(study).bench


@pytest.mark.contract
def test_the_shipped_files_were_found():
    assert {"serial", "sea"} <= {path.stem for path in EXAMPLES}
    assert {"sea_sensor", "damping_combined", "damping_smooth"} <= {path.stem for path in TUNED}


@pytest.mark.contract
@each_example
def test_every_example_is_a_valid_study_of_its_kind(path):
    study = load_study(path)
    assert study.kind == path.stem.removesuffix("-population")
    assert study.sweep.grid
    assert study.tune.parameters


@pytest.mark.contract
@pytest.mark.parametrize("path", TUNED, ids=lambda path: path.stem)
def test_every_tuned_configuration_is_valid_and_builds(path):
    config = load_config(path)
    if isinstance(config, DampingStudy):
        assert eqx.tree_equal(deployable_of(config, str(path)).build().controller, build(config.controller))
        scores = config.provenance
        assert scores["held_out"]["value"] < scores["before_on_held_out"]["value"]
        assert set(scores["tuned"]) <= numeric_paths(config).keys()
    else:
        assert build_estimator(config).needs


@pytest.mark.contract
def test_the_preset_file_is_the_librarys_awas_leaf_for_leaf():
    joint = build(validate(SerialJoint, read_toml(choose("joints", "awas", "here")), "awas"))
    assert eqx.tree_equal(joint, awas())


@pytest.mark.contract
@each_example
def test_every_number_of_a_study_is_a_leaf_of_the_bench_with_its_value(path):
    study = load_study(path)
    bench, numbers = built(study), numeric_paths(study)
    leaves = jax.tree.leaves(eqx.filter(bench, eqx.is_inexact_array))
    assert all(leaf.dtype == "float64" and not leaf.weak_type for leaf in leaves)
    for dotted, value in numbers.items():
        leaf = number(bench, dotted)
        assert any(leaf is one for one in leaves), dotted
        assert leaf.shape == ()
        assert float(leaf) == value
    # And no scalar leaf is out of reach.
    assert len(numbers) == sum(leaf.ndim == 0 for leaf in leaves)


@pytest.mark.contract
@each_example
def test_replacing_a_leaf_replaces_that_leaf_alone(path):
    study = load_study(path)
    bench, numbers = built(study), numeric_paths(study)
    assert with_leaves(bench, {}) is bench
    changed = with_leaves(bench, {dotted: 1.0 + number(bench, dotted) for dotted in list(numbers)[::3]})
    for i, (dotted, value) in enumerate(numbers.items()):
        assert float(number(changed, dotted)) == (value if i % 3 else 1.0 + value)


_SCALE = "estimator.basis.deflection_scale"


def within_limits(values: dict[str, float]) -> dict[str, float]:
    """Return numbers from 1 on within the limits of the example: only the deflection's scale has one above."""
    return values | ({_SCALE: min(values[_SCALE], 1e6)} if _SCALE in values else {})


@pytest.mark.equivalence
@settings(deadline=None, max_examples=50)
@given(st.dictionaries(st.sampled_from(sorted(NUMBERS)), st.floats(1.0, 1e300), min_size=1).map(within_limits))
def test_a_study_survives_toml_and_json(values):
    study = with_numbers(load_study(SERIAL, ["sweep={}", "tune={}"]), values, "drawn")
    tables = resolved(study)
    for text, read in ((to_toml(tables), tomllib.loads), (json.dumps(tables), json.loads)):
        again = parse_study(read(text), "again")
        assert again == study
        assert resolved(again) == tables
        assert study_hash(again) == study_hash(study)
    assert {path: numeric_paths(study)[path] for path in values} == values


@pytest.mark.equivalence
@each_example
def test_an_example_survives_toml_with_its_grid_and_bounds(path):
    study = load_study(path)
    assert parse_study(tomllib.loads(to_toml(resolved(study))), "again") == study


def leaves_of(tables, prefix=()):
    """Yield the keys and value of every number in nested tables and lists."""
    items = tables.items() if isinstance(tables, dict) else enumerate(tables)
    for key, value in items:
        if isinstance(value, dict | list):
            yield from leaves_of(value, (*prefix, key))
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield (*prefix, key), value


@each_example
def test_the_hash_changes_with_any_number(path):
    # With a sensor for the setpoint, one more term of it is allowed too; with more room, a longer window.
    room = {"antagonistic": ["estimator.side.longest_window=3.0"]}
    sensed = [] if path.stem == "damping" else ["sensing.setpoint_position={}"]
    study = load_study(path, [*sensed, *room.get(path.stem, [])])
    tables, hashes = resolved(study), {study_hash(study)}
    # An algebraic observer's sample time can only change together with the clock's.
    tied = {"schema_version"} | ({"sample_time"} if study.kind == "antagonistic" else set())
    found = [keys for keys, _ in leaves_of(tables) if keys[-1] not in tied]
    assert len(found) > len(numeric_paths(study))
    for *parents, last in found:
        changed = copy.deepcopy(tables)
        table = changed
        for key in parents:
            table = table[key]
        table[last] = table[last] + 1 if isinstance(table[last], int) else math.nextafter(table[last], math.inf)
        hashes.add(study_hash(parse_study(changed, "changed")))
    assert len(hashes) == len(found) + 1


def test_the_hash_does_not_change_with_name_and_provenance():
    plain = study_hash(load_study(SERIAL))
    assert plain == study_hash(load_study(SERIAL, ["name=other", "provenance={seed=3}"]))
    assert plain != study_hash(load_study(SERIAL, ["scorer.tolerance=0.06"]))


def test_numbers_are_replaced_and_held_to_their_limits():
    study = load_study(SERIAL)
    changed = with_numbers(study, {PRIOR: 3.0, "joint.link.inertia": 0.2}, "here")
    assert numeric_paths(changed) == numeric_paths(study) | {PRIOR: 3.0, "joint.link.inertia": 0.2}
    with pytest.raises(ValueError, match=r"here: estimator\.fit\.prior_scale: got -3\.0"):
        with_numbers(study, {PRIOR: -3.0}, "here")
