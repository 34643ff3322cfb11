"""Old names of what has moved: they lead to the same things, and warn."""

import importlib
import subprocess
import sys

import pytest

import vsajax
from vsajax import control, moved

MODULES = {f"vsajax.{old}": new for old, new in vsajax._MOVED.items()} | {
    f"vsajax.control.{name}": f"vsajax.{new}.{name}"
    for new, names in vsajax._FROM_CONTROL.items()
    for name in names
}


@pytest.mark.parametrize("old", sorted(MODULES))
def test_a_module_is_found_under_its_old_name(old, monkeypatch):
    monkeypatch.delitem(sys.modules, old, raising=False)
    new = importlib.import_module(MODULES[old])
    with pytest.warns(DeprecationWarning, match=f"{old} is now {MODULES[old]}"):
        module = importlib.import_module(old)
    own = [name for name, value in vars(new).items() if getattr(value, "__module__", None) == new.__name__]
    assert own
    assert all(getattr(module, name) is getattr(new, name) for name in own)
    with pytest.raises(AttributeError):
        _ = module.no_such_name


@pytest.mark.parametrize("name", sorted(vsajax._MOVED))
def test_a_module_is_an_attribute_under_its_old_name(name, monkeypatch):
    monkeypatch.delitem(vars(vsajax), name, raising=False)
    with pytest.warns(DeprecationWarning, match=f"vsajax.{name} is now"):
        assert getattr(vsajax, name) is importlib.import_module(vsajax._MOVED[name])


@pytest.mark.parametrize("new", sorted(control._MOVED))
def test_names_that_left_control_are_found_there(new):
    home = importlib.import_module(new)
    assert set(control._MOVED[new]) == set(home.__all__)
    for name in control._MOVED[new]:
        with pytest.warns(DeprecationWarning, match=f"vsajax.control.{name} is now {new}.{name}"):
            assert getattr(control, name) is getattr(home, name)


def test_what_never_was_is_an_error_as_ever():
    with pytest.raises(AttributeError, match="module 'vsajax' has no attribute 'nothing'"):
        _ = vsajax.nothing
    with pytest.raises(ImportError):
        importlib.import_module("vsajax.nothing")


def test_the_warning_names_the_line_that_imports(tmp_path):
    script = tmp_path / "own.py"
    script.write_text("import vsajax\n\nfrom vsajax.closed_loop import ControlLoop\n", encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-W", "always::DeprecationWarning", script], capture_output=True, text=True, check=True
    )
    assert f"{script}:3: DeprecationWarning: vsajax.closed_loop is now vsajax.experiments.damping" in done.stderr


def test_a_finder_knows_only_its_own():
    assert moved._OldModules({"a": "b"}).find_spec("c") is None
