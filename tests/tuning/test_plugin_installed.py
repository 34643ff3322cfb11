"""The example package as its users have it: a wheel, installed beside vsajax in an environment of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sysconfig
import venv
from pathlib import Path

import pytest

from tests.tuning.plugin import ROOT, STUDY, wheel_of_example

SHORT = ("--set", "clock.duration=1.0", "--set", "scorer.warm_up=0.5")


@pytest.mark.slow(
    twin=(
        "tests/tuning/test_plugins.py::test_what_uses_a_plug_in_is_simulated_and_exported",
        "tests/tuning/test_plugins.py::test_a_run_says_what_it_used_and_its_workers_refuse_what_they_lack",
    )
)
@pytest.mark.cli
def test_an_installed_package_is_used_by_every_method(tmp_path):
    # Its fast twins run the same package in this process and without an installation.
    bare, elsewhere = tmp_path / "bare", tmp_path / "elsewhere"
    elsewhere.mkdir()
    venv.create(bare, with_pip=True)
    scripts = bare / ("Scripts" if os.name == "nt" else "bin")

    def run(*words: object) -> str:
        environment = {
            k: v for k, v in os.environ.items() if k not in {"PYTHONPATH", "VIRTUAL_ENV", "VSAJAX_PLUGINS"}
        }
        command = list(map(str, words))
        ended = subprocess.run(
            command, cwd=elsewhere, env=environment, capture_output=True, text=True, check=False, timeout=1800
        )
        assert ended.returncode == 0, f"{command}\n{ended.stdout}\n{ended.stderr}"
        return ended.stdout

    # vsajax from this checkout, what it needs from the environment of this test.
    place = run(scripts / "python", "-c", "import sysconfig; print(sysconfig.get_paths()['purelib'])").strip()
    (Path(place) / "needs.pth").write_text(f"{ROOT}\n{sysconfig.get_paths()['purelib']}\n")
    pip = (scripts / "python", "-m", "pip", "install", "--quiet", "--no-deps", "--no-index")
    run(*pip, wheel_of_example(tmp_path))

    def vsajax(*words: object) -> str:
        return run(scripts / "python", "-m", "vsajax", *words)

    assert "[air-joint 0.1.0: air_joint.tables:AirSpring]" in vsajax("parts", "springs")
    assert "valid study" in vsajax("check", STUDY)
    vsajax("sweep", STUDY, "-o", "sweep", "--workers", "2", *SHORT)
    manifest = json.loads((elsewhere / "sweep" / "manifest.json").read_text())
    assert manifest["versions"]["air-joint"] == "0.1.0"
    vsajax("tune", STUDY, "-o", "tune", *SHORT)
    best = elsewhere / "tune" / "best.toml"
    assert '[plugins."air_joint.tables:AirSpring"]' in best.read_text()
    vsajax("montecarlo", best, "-o", "population", "--scenarios", "16")
    vsajax("report", "population")
    checked = json.loads(
        vsajax("export", best, "--to", "c99", "-o", "deploy", "--duration", "1", "--check", "--json")
    )
    assert checked["ok"] is True
