"""What a receiver's machine lacks is told, with the way out, and is not taken for a check that passed."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from tuning.exports.checks.checking import Result, run_checks
from tuning.exports.recheck import CHECKS

pytestmark = [pytest.mark.failure]


def passes():
    return Result("one", "passed", "it holds")


def lacks():
    import yaml_of_another_world  # noqa: F401  # pyright: ignore[reportMissingImports]

    return Result("other", "passed", "never")


def ended(capsys, *checks):
    with pytest.raises(SystemExit) as caught:
        run_checks(checks)
    return caught.value.code, capsys.readouterr().out


def test_what_was_skipped_has_not_passed(capsys):
    told = "lacks: yaml_of_another_world is not installed: pip install yaml_of_another_world\n"
    assert ended(capsys, passes, lacks) == (0, f"passed   one: it holds\nskipped  {told}")
    assert ended(capsys, lacks, lacks) == (1, 2 * f"failed   {told}")


FAKES = {
    "flatbuffers": {
        "flatbuffers.py": "raise ModuleNotFoundError(\"No module named 'flatbuffers'\", name='flatbuffers')"
    },
    "an older jax": {
        "flatbuffers.py": "",
        "jax/__init__.py": "__version__ = '0.4.30'\nclass config:\n    update = staticmethod(lambda *_: None)\n",
        "jax/export.py": "def deserialize(_):\n    raise ValueError('deserialize unsupported version 12')\n",
    },
    "a jax without export": {
        "flatbuffers.py": "",
        "jax/__init__.py": "__version__ = '0.4.20'\nclass config:\n    update = staticmethod(lambda *_: None)\n",
    },
}
WORDS = {
    "flatbuffers": "flatbuffers is not installed: pip install flatbuffers",
    "an older jax": "jax 0.4.30 cannot read what jax 0.12.0 wrote (deserialize unsupported version 12)",
    "a jax without export": "jax 0.4.20 cannot read what jax 0.12.0 wrote (No module named 'jax.export')",
}


@pytest.mark.parametrize("lacking", FAKES)
def test_a_jax_that_cannot_read_stablehlo_is_told_which_can(lacking, tmp_path):
    packages, folder = tmp_path / "packages", tmp_path / "export"
    for name, text in FAKES[lacking].items():
        (packages / name).parent.mkdir(parents=True, exist_ok=True)
        (packages / name).write_text(text)
    folder.mkdir()
    (folder / "manifest.json").write_text(json.dumps({"inputs": [], "stablehlo": {"jax": "0.12.0"}}))
    (folder / "init.stablehlo").write_bytes(b"")
    (folder / "scan.stablehlo").write_bytes(b"")
    (folder / "golden.csv").write_text("time\n0.0\n")
    (folder / "parameters.json").write_text("{}")
    run = subprocess.run(
        [sys.executable, CHECKS / "stablehlo.py", "--folder", folder, "--quick"],
        env=os.environ | {"PYTHONPATH": str(packages)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (run.returncode, run.stderr) == (1, "")
    assert run.stdout.startswith(f"failed   step: {WORDS[lacking]}")
    if lacking != "flatbuffers":
        assert "pip install jax==0.12.0 flatbuffers" in run.stdout
