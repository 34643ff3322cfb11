"""The rooms of the lab and their floors, read from the source: imports point down, also those inside functions."""

import ast
import re
from pathlib import Path

import pytest

import tuning

pytestmark = pytest.mark.structure

ROOT = Path(tuning.__file__).parent
FLOORS = (
    ("files",),
    ("terminal", "logs", "pictures"),
    ("study",),
    ("problem", "runs"),
    ("scoring", "exports", "testing"),
    ("search",),
    ("kinds",),
    ("papers", "bench", "report"),
    ("cli",),
)
"""From the ground up: a room imports rooms of lower floors alone, never one beside it."""
FLOOR_OF = {room: number for number, rooms in enumerate(FLOORS) for room in rooms}
TREES = {
    ".".join(path.relative_to(ROOT.parent).with_suffix("").parts).removesuffix(".__init__"): ast.parse(
        path.read_text(encoding="utf-8")
    )
    for path in sorted(ROOT.rglob("*.py"))
}
OLD_NAMES = {"tuning.build", "tuning.runtime"}
DOOR = {"tuning", "tuning.__main__"} | OLD_NAMES
"""What belongs to no room."""


def room_of(module: str) -> str:
    """Return the room that a module of the lab lies in."""
    return module.split(".")[1]


def imports(module: str, *, at_once: bool = False) -> set[str]:
    """Return the modules of the lab, and the packages beside it, that a module imports.

    Args:
        module: by its full name.
        at_once: only what is imported when the module is, by itself or by what it imports; no matter how deep.
    """
    tree = TREES[module]
    # What stands under `if TYPE_CHECKING` is never run.
    unseen = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        for inner in ast.walk(node)
    }
    if at_once:
        lazy = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)
        unseen |= {id(inner) for node in ast.walk(tree) if isinstance(node, lazy) for inner in ast.walk(node)}
    names = set()
    for node in ast.walk(tree):
        if at_once and id(node) in unseen:
            continue
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}: relative imports hide the floor"
            assert node.module is not None
            full = {f"{node.module}.{alias.name}" for alias in node.names}
            names |= {name if name in TREES else node.module for name in full}
    return names


def inside(module: str) -> set[str]:
    """Return the modules of the lab that a module imports."""
    return {name for name in imports(module) if name in TREES and name not in DOOR | {module}}


@pytest.mark.parametrize("module", sorted(TREES.keys() - DOOR))
def test_imports_point_down(module):
    own = room_of(module)
    assert own in FLOOR_OF, f"{module} lies in no room; give its folder a floor in FLOORS"
    others = {name for name in inside(module) if room_of(name) != own}
    wrong = {name for name in others if FLOOR_OF[room_of(name)] >= FLOOR_OF[own]}
    assert not wrong, f"{module} (floor {FLOOR_OF[own]}) reaches up to {sorted(wrong)}"


def test_no_modules_import_one_another():
    graph = {module: inside(module) for module in TREES.keys() - DOOR}
    while graph:
        ends = {module for module, names in graph.items() if not names & graph.keys()}
        assert ends, f"a circle among {sorted(graph)}"
        graph = {module: names for module, names in graph.items() if module not in ends}


def test_every_module_stands_in_a_room():
    loose = {module for module in TREES.keys() - DOOR if "." not in module.removeprefix("tuning.")}
    rooms = {module for module in loose if (ROOT / room_of(module)).is_dir()}
    assert loose == rooms, f"give them a room: {sorted(loose - rooms)}"
    assert {room_of(module) for module in TREES.keys() - DOOR} == FLOOR_OF.keys()


def test_nobody_but_the_commands_knows_a_kind():
    # What a method supports follows from what a kind has; a method that names one would not do so for the next.
    for module in TREES.keys() - DOOR:
        if room_of(module) in {"problem", "scoring", "search", "exports", "report"}:
            assert not {name for name in inside(module) if room_of(name) == "kinds"}, module


@pytest.mark.parametrize("room", ["files", "study"])
def test_checking_a_file_never_waits_for_jax(room):
    heavy = {"jax", "jaxlib", "equinox", "optimistix", "vsajax", "matplotlib", "scipy"}
    seen, waiting = set(), {module for module in TREES.keys() - DOOR if room_of(module) == room}
    waiting |= {module for module in TREES if module.endswith(".study") and room_of(module) == "kinds"}
    while waiting:
        module = waiting.pop()
        seen.add(module)
        names = imports(module, at_once=True)
        assert not {name.split(".")[0] for name in names} & heavy, module
        waiting |= {name for name in names if name in TREES} - seen


def test_the_page_on_the_architecture_has_these_floors(request):
    page = request.config.rootpath / "docs" / "architecture.md"
    rows = re.findall(r"^\| (\d+) \| ([^|]+) \|", page.read_text(encoding="utf-8"), re.MULTILINE)
    told = {int(number): set(re.findall(r"`(\w+)`", rooms)) for number, rooms in rows}
    assert told == {number: set(rooms) for number, rooms in enumerate(FLOORS, start=1)}
