"""The Python that documents show: what it imports is there, and it runs."""

import ast
import importlib
import os
import re
import subprocess
import sys
from typing import NamedTuple

import pytest

from tests.tuning.documented import ROOT, commands, documents

_BLOCK = re.compile(r"(?:^(```sh\n[^`]*```)\n\n)?^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)


class Block(NamedTuple):
    """A block of Python and the commands right before it."""

    commands: tuple[tuple[str, ...], ...]
    text: str


BLOCKS = {
    f"{document.name}-{number}": Block(
        tuple(c.words for c in commands(f"{found[1]}\n")) if found[1] else (), found[2]
    )
    for document in documents()
    for number, found in enumerate(_BLOCK.finditer(document.read_text(encoding="utf-8")))
}
EXAMPLE = ROOT / "examples" / "plugin" / "src"
"""A package that a document is about; its reader has it installed."""
each = pytest.mark.parametrize("name", sorted(BLOCKS))


@pytest.mark.filterwarnings("error::DeprecationWarning")
@each
def test_what_a_document_imports_is_there(name, monkeypatch):
    monkeypatch.syspath_prepend(EXAMPLE)
    for node in ast.walk(ast.parse(BLOCKS[name].text)):
        if isinstance(node, ast.Import):
            for alias in node.names:
                importlib.import_module(alias.name)
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            module = importlib.import_module(node.module)
            for alias in node.names:
                assert hasattr(module, alias.name) or importlib.import_module(f"{node.module}.{alias.name}")


@pytest.mark.slow(twin="test_what_a_document_imports_is_there")
@each
def test_the_python_of_a_document_runs(name, tmp_path):
    for shared in ("tests", "configs"):
        (tmp_path / shared).symlink_to(ROOT / shared)
    for words in (*BLOCKS[name].commands, ("python", "-c", BLOCKS[name].text)):
        start = (sys.executable, *(("-m", "tuning") if words[0] == "vsajax" else ()))
        done = subprocess.run(
            [*start, *words[1:]],
            cwd=tmp_path,
            env=os.environ
            | {"PYTHONPATH": os.pathsep.join(filter(None, [str(EXAMPLE), os.environ.get("PYTHONPATH")]))},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
