"""The Python that documents show: what it imports is there, and it runs."""

import ast
import importlib
import re

import pytest

from tests.tuning.documented import documents

BLOCKS = [
    pytest.param(match[1], id=f"{document.name}-{number}")
    for document in documents()
    for number, match in enumerate(
        re.finditer(r"^```python\n(.*?)^```", document.read_text(encoding="utf-8"), re.M | re.S)
    )
]


@pytest.mark.filterwarnings("error::DeprecationWarning")
@pytest.mark.parametrize("block", BLOCKS)
def test_what_a_document_imports_is_there(block):
    for node in ast.walk(ast.parse(block)):
        if isinstance(node, ast.Import):
            for alias in node.names:
                importlib.import_module(alias.name)
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            module = importlib.import_module(node.module)
            for alias in node.names:
                assert hasattr(module, alias.name) or importlib.import_module(f"{node.module}.{alias.name}")


SCRIPTS = sorted({document.name for document in documents() if "```python" in document.read_text(encoding="utf-8")})


@pytest.mark.slow
@pytest.mark.parametrize("name", SCRIPTS)
def test_the_python_of_a_document_runs(name):
    document = next(document for document in documents() if document.name == name)
    text = "\n".join(re.findall(r"^```python\n(.*?)^```", document.read_text(encoding="utf-8"), re.M | re.S))
    done = subprocess.run([sys.executable, "-c", text], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
