"""What a user waits for before a command has done anything."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.tuning.builders import SERIAL
from tuning.runs.machine import usable_cores

ROOT = Path(__file__).parents[3]
VSAJAX = Path(sys.executable).with_name("vsajax")
TRIES = 10


def shell(*words: object, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a command on the packages of this checkout, wherever the installed ones are."""
    own = {"PYTHONPATH": str(ROOT)} | environment
    return subprocess.run(
        list(map(str, words)), env=os.environ | own, capture_output=True, text=True, check=False, timeout=120
    )


@pytest.mark.cli
@pytest.mark.benchmark
@pytest.mark.parametrize(
    ("words", "limit"), [(("--help",), 0.3), (("check", SERIAL), 0.8), (("check", SERIAL, "--quiet"), 0.8)]
)
def test_help_and_check_answer_at_once(words, limit):
    # What the process worked, not what it waited for a busy machine; the least of several, as noise only adds.
    for _ in range(TRIES):
        before = worked()
        ended = shell(VSAJAX, *words)
        elapsed = worked() - before
        assert ended.returncode == 0, ended.stderr
        if elapsed < limit:
            return
    pytest.fail(f"never under {limit} s in {TRIES} runs; {elapsed:.2f} s the last time")


def worked() -> float:
    """Return the processor time of all ended children [s]."""
    times = os.times()
    return times.children_user + times.children_system


@pytest.mark.structure
@pytest.mark.parametrize("words", [["--help"], ["sweep", "--help"], ["check", str(SERIAL), "-q"]])
def test_help_and_check_do_not_import_what_is_slow(words):
    slow = ("jax", "scipy", "pyarrow", "matplotlib", "optimistix")
    code = f"import sys\nfrom tuning.cli.main import run\ncode = run({words})\n"
    code += f"sys.exit(code or str([name for name in {slow} if name in sys.modules]))"
    ended = shell(sys.executable, "-c", code)
    assert ended.stderr.strip() == "[]"


@pytest.mark.cli
def test_a_fresh_process_computes_in_double_precision_on_every_core(tmp_path):
    ended = shell(VSAJAX, "doctor", "--json", XLA_FLAGS="", VSAJAX_CACHE=str(tmp_path))
    assert (ended.returncode, ended.stderr) == (0, "")
    facts = json.loads(ended.stdout)
    assert facts["ok"] is True
    assert facts["float64"] is True
    assert len(facts["devices"]) == facts["cores"] == usable_cores()
    assert facts["compile_cache"] == str(tmp_path / "vsajax")
    assert {"vsajax", "jax", "jaxlib", "numpy"} <= facts["versions"].keys()
    assert all(isinstance(has, bool) for has in facts["extras"].values())


@pytest.mark.cli
def test_a_mistake_in_the_shell_ends_with_2_and_a_message(tmp_path):
    ended = shell(VSAJAX, "check", tmp_path / "none.toml")
    assert (ended.returncode, ended.stdout) == (2, "")
    assert ended.stderr == f"error: {tmp_path / 'none.toml'}: no such file\n    fix: check the path\n"
