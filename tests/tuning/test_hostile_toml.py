"""Files that somebody else made: whatever they hold, `check` takes it, or refuses it at once and in words."""

from __future__ import annotations

import tomllib
import unicodedata

import pytest

from tuning.files.kinds import kind_of
from tuning.files.shipped import shipped_files
from tuning.files.toml import read_toml

DEEP = 100_000
LONG = 100_000
HOSTILE = {
    "lists without end": "x = " + "[" * DEEP,
    "nested lists": "x = " + "[" * DEEP + "]" * DEEP,
    "nested tables": "x = " + "{a = " * 5000 + "1" + "}" * 5000,
    "a path of tables": "x" + ".a" * 900 + " = 1",
    "a number that Python does not read": "x = " + "9" * 5000,
    "a number that TOML does not have": "x = 99999999999999999999",
    "a key that clears the screen": '"\\u001b[2J" = 1',
    "a key that writes a line": '"x\\nerror: mine" = 1',
    "a key that turns text around": '"\\u202ex" = 1',
    "a key of Python's": "__class__ = { __init__ = 1 }",
    "a key of pydantic's": "model_config = {}\nmodel_fields = 1",
    "an empty key": '"" = 1',
    "a long key": "x" * LONG + " = 1",
    "a long text": f'x = "{"x" * LONG}"',
    "many keys": "\n".join(f"x{i} = 1" for i in range(100)),
    "a zero byte": "# \0",
    "half a letter": 'x = "\\ud800"',
    "a kind of everything": "[recording]\n[estimator]\n[plant]\n[arm]\n[signals]",
}
MOST = 2**16
"""Characters of what may be said of one file."""
EACH = (
    *("studies/serial", "studies/damping", "studies/arm", "tuned/sea_sensor", "log_studies/quanser_flex"),
    *("logs/hebi", "joints/awas", "arms/planar-3"),
)
"""A shipped file of every sort."""


def is_shown(text: str) -> bool:
    """Return whether a terminal shows a text rather than obeys it."""
    return not {letter for letter in text if unicodedata.category(letter) in {"Cc", "Cf", "Cs"}} - {"\n"}


@pytest.mark.structure
def test_there_is_a_file_of_every_sort():
    sorts = {str(kind_of(read_toml(path))) for path in shipped_files().values()}
    assert {str(kind_of(read_toml(shipped_files()[name]))) for name in EACH} == sorts


@pytest.mark.cli
@pytest.mark.failure
@pytest.mark.parametrize("what", HOSTILE)
def test_what_is_put_into_any_file_is_refused_in_words(what, vsajax, tmp_path):
    path = tmp_path / "theirs.toml"
    for name in EACH:
        text = shipped_files()[name].read_text(encoding="utf-8")
        path.write_text(f"{HOSTILE[what]}\n{text}", encoding="utf-8")
        ended = vsajax("check", path)
        assert (ended.code, ended.out) == (2, ""), name
        assert ended.err.startswith(f"error: {path}"), name
        assert "Traceback" not in ended.err, name
        assert is_shown(ended.err), name
        assert len(ended.err) < MOST, name


def texts_in(tables, prefix=()):
    """Yield the place of every text in nested tables."""
    for key, value in tables.items():
        if isinstance(value, dict):
            yield from texts_in(value, (*prefix, key))
        elif isinstance(value, str):
            yield (*prefix, key)


@pytest.mark.cli
@pytest.mark.failure
@pytest.mark.parametrize("name", shipped_files())
def test_a_text_that_steers_a_terminal_is_never_sent_to_it(name, vsajax, tmp_path):
    text = shipped_files()[name].read_text(encoding="utf-8")
    path = tmp_path / "theirs.toml"
    for place in texts_in(tomllib.loads(text)):
        value = tomllib.loads(text)
        for key in place:
            value = value[key]
        # As it is written: a text is a text wherever it stands.
        path.write_text(text.replace(f'"{value}"', '"\\u001b]0;mine\\u0007\\u202e"'), encoding="utf-8")
        ended = vsajax("check", path)
        assert ended.code in {0, 2}, place
        assert is_shown(ended.out), place
        assert is_shown(ended.err), place


@pytest.mark.cli
@pytest.mark.parametrize("name", shipped_files())
def test_how_an_editor_saves_a_file_makes_no_difference(name, vsajax, tmp_path):
    text = shipped_files()[name].read_text(encoding="utf-8")
    path = tmp_path / "saved.toml"
    printed = set()
    for saved in (text, text.replace("\n", "\r\n"), f"\ufeff{text}"):
        path.write_bytes(saved.encode("utf-8"))
        ended = vsajax("check", path)
        assert (ended.code, ended.err) == (0, "")
        printed.add(ended.out)
    assert len(printed) == 1
