"""vsajax as it is installed: from a wheel, in an environment of its own, used from another folder."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest

from tuning.files.shipped import shipped_files

ROOT = Path(__file__).parents[2]
STUDY = ("--set", "clock.duration=0.2", "--set", "sweep={}", "--set", "tune={}")


def _run(*words: object, folder: Path, path: Path | None = None) -> str:
    """Run a command elsewhere than in the checkout, of which it must know nothing, and return what it prints."""
    environment = {k: v for k, v in os.environ.items() if k not in {"PYTHONPATH", "VIRTUAL_ENV"}}
    environment |= {} if path is None else {"PYTHONPATH": str(path)}
    ran = subprocess.run(
        [str(word) for word in words], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, f"{words}\n{ran.stdout}\n{ran.stderr}"
    assert str(ROOT) not in ran.stdout
    return ran.stdout


@pytest.fixture
def laid_out(tmp_path) -> Path:
    """A folder with the packages as the build table of pyproject.toml lays them out in a wheel."""
    built = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["wheel"]
    for name in built["packages"]:
        shutil.copytree(ROOT / name, tmp_path / "site" / name, ignore=shutil.ignore_patterns("__pycache__"))
    for source, target in built["force-include"].items():
        shutil.copytree(ROOT / source, tmp_path / "site" / target)
    return tmp_path / "site"


@pytest.mark.cli
def test_what_a_wheel_holds_is_enough_away_from_the_checkout(laid_out, tmp_path):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()

    def vsajax(*words: str) -> str:
        return _run(sys.executable, "-m", "vsajax", *words, folder=elsewhere, path=laid_out)

    listed = vsajax("init", "--list")
    assert all(f"\n{name} " in f"\n{listed}" for name in shipped_files())
    vsajax("init", "sea", "mine.toml")
    assert "valid study" in vsajax("check", "mine.toml")
    assert "valid signal map" in vsajax("check", "shipped:logs/hebi")
    where = "import tuning, tuning.files.shipped as r; print(tuning.__file__, r.CONFIGS)"
    package, configs = _run(sys.executable, "-c", where, folder=elsewhere, path=laid_out).split()
    assert Path(package).is_relative_to(laid_out)
    assert Path(configs).is_relative_to(laid_out)


@pytest.mark.slow(twin="test_what_a_wheel_holds_is_enough_away_from_the_checkout")
@pytest.mark.cli
def test_a_wheel_is_built_installed_and_used(tmp_path):
    wheels, elsewhere, bare = tmp_path / "wheels", tmp_path / "elsewhere", tmp_path / "bare"
    elsewhere.mkdir()
    source = tmp_path / "source"

    def left_out(folder: str, names: list[str]) -> set[str]:
        # The user's runs lie beside the packages; the lab has a folder of that name too.
        here = {".git", ".venv", "runs", "shared"} if Path(folder) == ROOT else set()
        return (here | {"__pycache__"}) & set(names)

    shutil.copytree(ROOT, source, ignore=left_out)
    _run(sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "-w", wheels, source, folder=tmp_path)
    (wheel,) = wheels.glob("vsajax-*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    assert {f"tuning/configs/{name}.toml" for name in shipped_files()} <= set(names)
    assert not [name for name in names if name.startswith(("tests/", "docs/"))]
    venv.create(bare, with_pip=True)
    scripts = bare / ("Scripts" if os.name == "nt" else "bin")
    python = scripts / "python"
    _run(python, "-m", "pip", "install", "--quiet", "--no-deps", wheel, folder=elsewhere)
    # What vsajax needs is taken from the environment of this test; it comes after the wheel on the path.
    site = _run(
        python, "-c", "import sysconfig; print(sysconfig.get_paths()['purelib'])", folder=elsewhere
    ).strip()
    (Path(site) / "needs.pth").write_text(sysconfig.get_paths()["purelib"] + "\n")
    program = scripts / "vsajax"
    where = _run(python, "-c", "import tuning; print(tuning.__file__)", folder=elsewhere)
    assert Path(where.strip()).is_relative_to(bare)
    assert "studies/serial" in _run(program, "init", "--list", folder=elsewhere)
    _run(program, "init", "serial", "study.toml", folder=elsewhere)
    _run(program, "check", "study.toml", folder=elsewhere)
    _run(program, "simulate", "study.toml", "-o", "r.csv", *STUDY, folder=elsewhere)
    _run(program, "estimate", "r.csv", "-c", "study.toml", "-o", "e.csv", *STUDY, folder=elsewhere)
    exported = ("export", "shipped:tuned/sea_sensor", "--to", "json", "-o", "deploy", "--duration", "0.2")
    _run(program, *exported, folder=elsewhere)
    assert (elsewhere / "deploy" / "README.md").is_file()
