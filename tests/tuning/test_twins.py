"""Every slow test names a fast one that holds the same promise, read from the source of the tests.

A test is slow by `@pytest.mark.slow(twin="test_name")`, of the same file, or
`twin="tests/…/test_x.py::test_name"`; a promise that takes several has a tuple of them. Where some cases of a test
are slow and others are not, the others are the twin: there `marks=pytest.mark.slow` names none.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

pytestmark = pytest.mark.structure

TESTS = Path(__file__).parents[1]
TREES = {
    path.relative_to(TESTS.parent).as_posix(): ast.parse(path.read_text(encoding="utf-8"))
    for path in sorted(TESTS.rglob("*.py"))
}
Function = ast.FunctionDef | ast.AsyncFunctionDef


def is_slow_mark(node: ast.AST) -> bool:
    """Return whether an expression is `pytest.mark.slow`, called or not."""
    return ast.unparse(node.func if isinstance(node, ast.Call) else node) == "pytest.mark.slow"


def holds_slow(node: ast.AST) -> bool:
    """Return whether the mark is somewhere in an expression."""
    return any(is_slow_mark(inner) for inner in ast.walk(node))


def has_fast_case(node: ast.AST) -> bool:
    """Return whether some of the cases that an expression lists are not slow."""
    match node:
        case ast.List() | ast.Tuple():
            return any(has_fast_case(inner) for inner in node.elts)
        case ast.Starred():
            return has_fast_case(node.value)
        case ast.ListComp() | ast.GeneratorExp():
            return has_fast_case(node.elt)
        case ast.IfExp():
            return has_fast_case(node.body) or has_fast_case(node.orelse)
        case ast.Call() if ast.unparse(node.func) == "pytest.param":
            marks = [keyword.value for keyword in node.keywords if keyword.arg == "marks"]
            branches = [
                b for one in marks for b in ([one.body, one.orelse] if isinstance(one, ast.IfExp) else [one])
            ]
            return not branches or not all(map(holds_slow, branches))
        case _:
            return not holds_slow(node)


def functions(tree: ast.Module) -> Iterator[Function]:
    """Yield every function of a file, also those within others."""
    for node in ast.walk(tree):
        if isinstance(node, Function):
            yield node


def slow_marks(node: ast.AST) -> list[ast.AST]:
    """Return the slow marks in an expression; of one that is called, the call."""
    marks = [inner for inner in ast.walk(node) if is_slow_mark(inner)]
    names = [mark.func for mark in marks if isinstance(mark, ast.Call)]
    return [mark for mark in marks if mark not in names]


def cases_of(decorator: ast.AST) -> list[ast.AST]:
    """Return what a decorator lists cases by: `parametrize` its second argument, a fixture `params`."""
    if not isinstance(decorator, ast.Call) or is_slow_mark(decorator):
        return []
    return [*decorator.args[1:], *(k.value for k in decorator.keywords if k.arg in {"params", "argvalues"})]


def marks_of(tree: ast.Module, function: Function) -> list[ast.AST]:
    """Return the slow marks of a test as a whole: its own, its file's, and those of cases that are all slow."""
    for_all = [
        node.value
        for node in tree.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "pytestmark"
    ]
    own = [one for one in function.decorator_list if not any(map(has_fast_case, cases_of(one)))]
    return [mark for node in (*for_all, *own) for mark in slow_marks(node)]


def twins_of(mark: ast.AST, file: str) -> list[str]:
    """Return the tests that a mark names, each with its file."""
    assert isinstance(mark, ast.Call), "names no twin"
    (keyword,) = mark.keywords
    assert keyword.arg == "twin"
    named = ast.literal_eval(keyword.value)
    return [one if "::" in one else f"{file}::{one}" for one in ([named] if isinstance(named, str) else named)]


SLOW = {
    f"{file}::{function.name}": marks
    for file, tree in TREES.items()
    for function in functions(tree)
    if (marks := marks_of(tree, function))
}
ALL = {f"{file}::{function.name}" for file, tree in TREES.items() for function in functions(tree)}


def test_there_are_slow_tests_and_fast_cases_are_told_from_slow_ones():
    assert len(SLOW) > 30
    for text, fast in (
        ("[1, pytest.param(2, marks=pytest.mark.slow)]", True),
        ("[pytest.param(1, marks=pytest.mark.slow), pytest.param(2, marks=pytest.mark.slow)]", False),
        ("[n if n in A else pytest.param(n, marks=pytest.mark.slow) for n in B]", True),
        ("[pytest.param(n, marks=[pytest.mark.slow] if n in A else []) for n in B]", True),
        ("[pytest.param(n, marks=pytest.mark.slow) for n in B]", False),
        ("[1, *(pytest.param(n, marks=pytest.mark.slow) for n in B)]", True),
    ):
        assert has_fast_case(ast.parse(text, mode="eval").body) == fast, text


@pytest.mark.parametrize("name", sorted(SLOW))
def test_a_slow_test_has_a_fast_twin(name):
    file = name.partition("::")[0]
    for mark in SLOW[name]:
        for twin in twins_of(mark, file):
            assert twin in ALL, f"{name}: there is no {twin}"
            assert twin.rpartition("::")[2].startswith("test_"), twin
            assert twin not in SLOW, f"{name}: {twin} is slow itself"
