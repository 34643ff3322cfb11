"""JSON Schemas of the files that the lab reads agree with what `vsajax check` says of them."""

import copy
import itertools
import json
import tomllib

import jsonschema
import pytest

from tuning.files.shipped import CONFIGS
from tuning.study.schemas import name_in, schema_file, schema_names, schema_of

FILES = {
    path.relative_to(CONFIGS).as_posix(): tables
    for path in sorted(CONFIGS.glob("*/*.toml"))
    if name_in(tables := tomllib.loads(path.read_text(encoding="utf-8"))) is not None
}
each_file = pytest.mark.parametrize("name", FILES)
WRONG = ["text", True, -1.0, [], {}]


@pytest.fixture(scope="module")
def validators():
    """Validators by the name of the schema."""
    return {name: jsonschema.Draft202012Validator(schema_of(name)) for name in schema_names()}


def leaves(tables, path=()):
    """Return the paths of everything in tables that is no table."""
    for key, value in tables.items():
        if isinstance(value, dict):
            yield from leaves(value, (*path, key))
        else:
            yield (*path, key)


def changed(tables, path, value):
    """Return tables with a value replaced, or removed where it is `None`."""
    whole = copy.deepcopy(tables)
    inner = whole
    for key in path[:-1]:
        inner = inner[key]
    if value is None:
        del inner[path[-1]]
    else:
        inner[path[-1]] = value
    return whole


def mistakes_of(tables):
    """Return how many mistakes each table by itself has, as the command that reads the file would find them."""
    from tuning.files.errors import InputError
    from tuning.logs.signal_map import SignalMap
    from tuning.study.base import Config
    from tuning.study.kinds import kind_named

    name = name_in(tables)
    try:
        if name == "map":
            from tuning.files.toml import validate

            validate(SignalMap, tables, "")
        else:
            (Config if name == "estimator" else kind_named(name).tables.load()).parsed(tables, "")
    except InputError as error:
        return len(error.mistakes)
    return 0


@pytest.mark.contract
def test_every_kind_has_a_schema():
    assert {"serial", "sea", "antagonistic", "damping", "arm", "log", "estimator", "map"} == set(schema_names())
    assert {name_in(tables) for tables in FILES.values()} == set(schema_names())


@pytest.mark.contract
@pytest.mark.parametrize("name", ["serial", "sea", "antagonistic", "damping", "arm", "log", "estimator", "map"])
def test_a_schema_is_one(name):
    jsonschema.Draft202012Validator.check_schema(schema_of(name))


@pytest.mark.equivalence
@each_file
def test_a_shipped_file_is_valid(name, validators):
    tables = FILES[name]
    assert not [error.message for error in validators[name_in(tables)].iter_errors(tables)]


@pytest.mark.equivalence
@each_file
@pytest.mark.parametrize("every", [7, pytest.param(1, marks=pytest.mark.slow)], ids=["some", "all"])
def test_what_a_schema_refuses_check_refuses(name, every, validators):
    tables, kind = FILES[name], name_in(FILES[name])
    refused = agreed = 0
    for path, value in list(itertools.product(leaves(tables), (*WRONG, None)))[::every]:
        other = changed(tables, path, value)
        if name_in(other) != kind:
            continue
        if not validators[kind].is_valid(other):
            refused += 1
            assert mistakes_of(other), f"{'.'.join(path)} = {value!r}"
        elif not mistakes_of(other):
            agreed += 1
    # The test can fail: there is something to refuse, and where all is tried something to take.
    assert refused
    assert agreed or every > 1


@pytest.mark.equivalence
@each_file
def test_a_key_that_no_table_has_is_refused_by_both(name, validators):
    tables, kind = FILES[name], name_in(FILES[name])
    tables_of = {path[:-1] for path in leaves(tables)}
    found = 0
    for table in tables_of:
        other = changed(tables, (*table, "no_such_key"), 1.0)
        # Some tables are named by the user: axes, parameters, what varies.
        if mistakes_of(other):
            found += 1
            # Of a preset's tables the schema knows the names alone.
            if not any("preset" in part for part in _along(tables, table)):
                assert not validators[kind].is_valid(other), table
    assert found


def _along(tables, path):
    """Return the tables along a path, the outermost apart."""
    for key in path:
        tables = tables[key]
        yield tables


@pytest.mark.cli
def test_init_writes_the_line_for_editors_and_the_schema_beside(vsajax, tmp_path):
    ended = vsajax("init", "serial", tmp_path / "study.toml")
    assert (ended.code, ended.err) == (0, "")
    first = (tmp_path / "study.toml").read_text(encoding="utf-8").splitlines()[0]
    assert first == f"#:schema {schema_file('serial')}"
    assert json.loads((tmp_path / schema_file("serial")).read_text(encoding="utf-8")) == schema_of("serial")
    assert vsajax("check", tmp_path / "study.toml", "--quiet").code == 0


@pytest.mark.cli
def test_the_command_prints_and_writes_it(vsajax, tmp_path):
    printed = vsajax("schema", "damping")
    assert (printed.code, printed.err, json.loads(printed.out)) == (0, "", schema_of("damping"))
    ended = vsajax("schema", "map", "-o", tmp_path / "map.schema.json")
    assert ended.out.splitlines()[-1].startswith("Next: vsajax ")
    assert json.loads((tmp_path / "map.schema.json").read_text(encoding="utf-8")) == schema_of("map")
    wrong = vsajax("schema", "serail")
    assert (wrong.code, wrong.out) == (2, "")
    assert "allowed: antagonistic, arm" in wrong.err
