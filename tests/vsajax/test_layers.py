"""Import layers and the places of dangerous words, read from the source."""

import ast
from pathlib import Path

import pytest

import vsajax

pytestmark = pytest.mark.structure

ROOT = Path(vsajax.__file__).parent
MODULES = {
    ".".join(path.relative_to(ROOT.parent).with_suffix("").parts).removesuffix(".__init__"): ast.parse(
        path.read_text(encoding="utf-8")
    )
    for path in sorted(ROOT.rglob("*.py"))
}

# What each part of the library may import of the others; itself always.
ALLOWED = {
    "moved": set(),
    "showing": set(),
    "types": {"showing"},
    "numerics": {"types"},
    "rollout": {"types", "numerics"},
    "jumps": {"types", "rollout"},
    "guard": {"types", "jumps"},
    "arms": {"types", "numerics"},
    "solvers": {"types", "numerics", "rollout"},
    "plants": {"types", "numerics", "rollout", "arms"},
    "sensing": {"types", "numerics"},
    "estimators": {"types", "numerics", "rollout"},
    "control": {"moved", "types", "numerics", "rollout"},
    "compliance": {"types", "numerics", "rollout", "arms", "solvers"},
    "scores": {"types", "numerics", "showing"},
    "switching": {"types", "numerics", "rollout"},
}
# The floor that knows plants and estimators or controllers.
TOP = {"", "__main__", "experiments"}
PACKAGES = (
    "arms",
    "compliance",
    "control",
    "estimators",
    "numerics",
    "plants",
    "scores",
    "sensing",
    "solvers",
    "switching",
)


def imports(tree: ast.Module) -> set[str]:
    """Return the full names that a module imports, also inside functions."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative imports hide the layer"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def attributes(tree: ast.Module) -> set[str]:
    """Return every dotted name that a module mentions."""
    return {ast.unparse(node) for node in ast.walk(tree) if isinstance(node, ast.Attribute)}


def part_of(name: str) -> str:
    """Return which part of the library a full name belongs to."""
    parts = name.split(".")
    return parts[1] if len(parts) > 1 else ""


@pytest.mark.parametrize("module", MODULES)
def test_imports_point_down(module):
    part = part_of(module)
    if part not in ALLOWED:
        assert part in TOP, f"{module} has no layer; give it one in ALLOWED"
        return
    inner = {part_of(name) for name in imports(MODULES[module]) if name.split(".")[0] == "vsajax"}
    assert inner <= ALLOWED[part] | {part}, f"{module} reaches up to {sorted(inner - ALLOWED[part] - {part})}"


@pytest.mark.parametrize("module", MODULES)
def test_library_never_imports_the_lab(module):
    tops = {name.split(".")[0] for name in imports(MODULES[module])}
    standard = {"__future__", "abc", "collections", "enum", "functools", "itertools", "math", "typing"}
    # `python -m vsajax` looks up the command that is installed beside the library; nothing else may look about.
    door = {"importlib"} if module == "vsajax.__main__" else set()
    # Asked for by who has them, when they are called.
    door |= {"html", "matplotlib", "pandas"} if module == "vsajax.showing" else set()
    # Old names lead to new ones only when they are asked for.
    door |= {"importlib", "sys", "types", "warnings"} if module == "vsajax.moved" else set()
    assert tops <= standard | door | {
        "vsajax",
        "equinox",
        "jax",
        "jaxtyping",
        "numpy",
    }


@pytest.mark.parametrize("module", MODULES)
def test_only_rollout_runs_loops(module):
    loops = {"scan", "while_loop", "fori_loop", "map", "associative_scan"}
    names = {name for name in attributes(MODULES[module]) if name.startswith("jax.lax.")}
    names |= {name for name in imports(MODULES[module]) if name.startswith("jax.lax.")}
    used = {name.rsplit(".")[-1] for name in names} & loops
    assert not used or module == "vsajax.rollout.loops", f"{module} uses {sorted(used)}; rollout owns the loops"


@pytest.mark.parametrize("module", MODULES)
def test_importing_configures_nothing(module):
    # Reading whether double precision is on is fine; switching it on is the program's business.
    written = {name for name in attributes(MODULES[module]) if name.startswith("jax.config.update")}
    assert not written
    assigned = [
        ast.unparse(target)
        for node in ast.walk(MODULES[module])
        if isinstance(node, ast.Assign)
        for target in node.targets
    ]
    assert not [name for name in assigned if name.startswith(("jax.config", "os.environ"))]


def test_estimators_know_no_plant_and_no_control():
    # The rule that lets an estimator run on a robot's log, spelled out.
    for module, tree in MODULES.items():
        if part_of(module) == "estimators":
            assert not {part_of(name) for name in imports(tree)} & {"plants", "control", "sensing", "experiments"}


def test_public_names_exist_and_are_sorted():
    for module in (
        "vsajax",
        *(f"vsajax.{part}" for part in PACKAGES),
    ):
        package = __import__(module, fromlist=["__all__"])
        assert package.__all__ == sorted(package.__all__)
        assert all(hasattr(package, name) for name in package.__all__)
