"""Every command explains itself."""

from __future__ import annotations

import shlex

import click
import pytest

from tuning.cli.main import cli

each_command = pytest.mark.parametrize("name", sorted(cli.commands))


@pytest.mark.contract
def test_the_commands_are_those_of_the_lab():
    expected = {"init", "check", "simulate", "estimate", "sweep", "tune", "reproduce", "export", "doctor"}
    assert expected <= cli.commands.keys()


@pytest.mark.contract
@each_command
def test_a_command_has_a_sentence_an_example_json_and_quiet(name, vsajax):
    ended = vsajax(name, "--help")
    assert (ended.code, ended.err) == (0, "")
    for words in (f"Usage: vsajax {name}", f"Example: vsajax {name}", "--json", "--quiet"):
        assert words in ended.out
    assert vsajax(name, "-h").out == ended.out


@pytest.mark.contract
@each_command
def test_every_option_is_explained(name):
    assert cli.commands[name].help
    for parameter in cli.commands[name].params:
        assert not isinstance(parameter, click.Option) or parameter.help, parameter.name


@pytest.mark.contract
@each_command
def test_the_example_is_a_command_line_that_is_understood(name):
    command = cli.commands[name]
    program, called, *words = shlex.split(command.epilog.removeprefix("Example: "))
    assert (program, called) == ("vsajax", name)
    command.make_context(name, words, parent=cli.make_context("vsajax", [name]))


@pytest.mark.contract
@pytest.mark.parametrize("name", ["sweep", "tune"])
def test_what_takes_minutes_can_be_resumed_and_seeded(name):
    options = {option for parameter in cli.commands[name].params for option in parameter.opts}
    assert {"-o", "--resume", "--seed", "--set"} <= options


@pytest.mark.cli
def test_the_group_lists_every_command_and_where_to_start(vsajax):
    ended = vsajax("--help")
    assert ended.code == 0
    assert "vsajax init serial study.toml" in ended.out
    for name in cli.commands:
        assert f"\n  {name} " in ended.out
    assert vsajax("--version").out.startswith("vsajax, version ")


@pytest.mark.cli
@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "Usage: vsajax"),
        (("chek",), "No such command 'chek'"),
        (("check",), "Missing argument 'STUDY'"),
        (("check", "a.toml", "--seed", "3"), "No such option"),
        (("sweep", "a.toml"), "Missing option '-o'"),
        (("sweep", "a.toml", "-o", "x", "--scenarios", "0"), "0 is not in the range x>=1"),
        (("tune", "a.toml", "-o", "x", "--method", "luck"), "'luck' is not one of"),
        (("simulate", "a.toml", "--scenario", "-1"), "-1 is not in the range x>=0"),
        (("export", "a.toml", "-o", "x"), "Missing option '--to'"),
        (("reproduce", "nature"), "'nature' is not"),
    ],
)
def test_a_command_line_that_is_not_understood_ends_with_2(words, said, vsajax):
    ended = vsajax(*words)
    assert (ended.code, ended.out) == (2, "")
    assert said in ended.err


@pytest.mark.cli
def test_the_shell_completes_commands_and_options_as_documented(monkeypatch, capsys):
    from tuning.cli.main import run

    for typed, wanted in (("vsajax sw", "sweep"), ("vsajax sweep --sc", "--scenarios")):
        monkeypatch.setenv("_VSAJAX_COMPLETE", "bash_complete")
        monkeypatch.setenv("COMP_WORDS", typed)
        monkeypatch.setenv("COMP_CWORD", str(len(typed.split()) - 1))
        with pytest.raises(SystemExit) as ended:
            run([])
        assert ended.value.code == 0
        assert f"plain,{wanted}" in capsys.readouterr().out.splitlines()
