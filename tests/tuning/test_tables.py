"""Tables of TOML files: what no reader could take is refused with its place, however it is written."""

from __future__ import annotations

import pytest

from tests.tuning.builders import SERIAL
from tuning.files.errors import InputError
from tuning.files.tables import DEEPEST, parse_toml, with_settings

DIGITS = "1" + 20 * "0"
NESTED = 500
DEEP = {
    "lists": "x = " + NESTED * "[" + NESTED * "]",
    "tables": "x = " + NESTED * "{a = " + "1" + NESTED * "}",
    "a dotted key": "x" + NESTED * ".a" + " = 1",
    "a header": "[x" + NESTED * ".a" + "]",
    "barely": "x = " + DEEPEST * "[" + DEEPEST * "]",
}
LONG = {
    "20 digits": f"[sweep]\nscenarios = {DIGITS}",
    "5000 digits": f"[sweep]\nscenarios = {5000 * '9'}",
    "5000 digits in base 16": f"[sweep]\nscenarios = 0x{5000 * 'f'}",
    "20 digits, negative": f"[sweep]\nscenarios = -{DIGITS}",
    "in a list": f"[sweep]\nscenarios = [{DIGITS}]",
}


@pytest.mark.failure
@pytest.mark.parametrize("text", DEEP.values(), ids=DEEP)
def test_tables_that_nest_too_deep_are_refused(text):
    with pytest.raises(InputError, match=r"study\.toml: nests more than 48 tables or lists in one another"):
        parse_toml(text, "study.toml", "")


@pytest.mark.failure
@pytest.mark.parametrize("text", LONG.values(), ids=LONG)
def test_whole_numbers_that_toml_does_not_have_are_refused(text):
    with pytest.raises(InputError, match=r"study\.toml.* (got a whole number of|holds a number)") as caught:
        parse_toml(text, "study.toml", "")
    assert len(str(caught.value)) < 400


def test_what_a_study_has_is_read():
    assert parse_toml("x = [[1], {a = [2]}]\ny = 9223372036854775807", "s", "")["y"] == 2**63 - 1
    parse_toml("x = " + (DEEPEST - 2) * "[" + (DEEPEST - 2) * "]", "s", "")


@pytest.mark.failure
@pytest.mark.parametrize("text", [*DEEP.values(), *LONG.values()], ids=[*DEEP, *LONG])
@pytest.mark.parametrize("command", ["check", "simulate", "sweep -o run", "export --to json -o out"])
def test_every_command_refuses_them(text, command, vsajax, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    first, *rest = command.split()
    (tmp_path / "study.toml").write_text(f"{text}\n")
    ended = vsajax(first, "study.toml", *rest)
    assert (ended.code, ended.out) == (2, "")
    assert ended.err.startswith("error: study.toml")
    assert [path.name for path in tmp_path.iterdir()] == ["study.toml"]


@pytest.mark.failure
@pytest.mark.parametrize(
    "setting",
    [f"seed={NESTED * '['}{NESTED * ']'}", f"seed={5000 * '9'}", f"seed=0x{5000 * 'f'}", f"x{NESTED * '.a'}=1"],
    ids=["deep", "long", "long in base 16", "a deep path"],
)
def test_a_setting_is_refused_likewise(setting, vsajax):
    with pytest.raises(InputError, match="--set"):
        with_settings({}, [setting])
    ended = vsajax("check", SERIAL, "--set", setting)
    assert (ended.code, ended.out) == (2, "")
    assert len(ended.err) < 600
