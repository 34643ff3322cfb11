"""C functions from a step program: what is prepared once, how the state starts, what a sample does."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from tuning.exports.c99.expressions import Assign, Index, Read, Repeat, Role, Storage, Type, assigns, operations
from tuning.exports.c99.fusing import fuse
from tuning.exports.c99.lowering import Code, Lowering, settle
from tuning.exports.c99.naming import identifier
from tuning.exports.c99.primitives import type_of
from tuning.exports.c99.values import Value, stored
from tuning.exports.flatten import Equation, Flat, Symbol
from tuning.exports.layout import Leaf, Path
from tuning.exports.program import Places, Slot, StepProgram

_COMBINED = {"sum": "add", "product": "mul"}
"""The operations of an accumulation, where they have another name."""


@dataclass(frozen=True)
class Derived:
    """A value that follows from the parameters alone, computed once.

    Args:
        name: in the struct of derived values.
        shape: its dimensions.
        type: of its elements.
    """

    name: str
    shape: tuple[int, ...]
    type: Type


@dataclass(frozen=True)
class Generated:
    """A program's functions as statements.

    Args:
        derived: values that follow from the parameters.
        prepare: computes them.
        init: sets the state.
        step: processes a sample.
        operations: of one step, every branch of a choice counted.
    """

    derived: tuple[Derived, ...]
    prepare: Code
    init: Code
    step: Code
    operations: Counter[str]


def count(code: Code) -> Counter[str]:
    """Return how many operations of each kind some code runs through, every branch of a choice counted."""
    return _counted(code.statements)


def _counted(statements: Sequence[Assign | Repeat]) -> Counter[str]:
    total: Counter[str] = Counter()
    for statement in statements:
        if isinstance(statement, Repeat):
            for name, n in _counted(statement.body).items():
                total[name] += n * statement.times
            continue
        for name, n in operations(statement.value).items():
            total[name] += n * statement.times
        if statement.inner and statement.combine != "place":
            total[_COMBINED.get(statement.combine, statement.combine)] += statement.times
    return total


def generate(program: StepProgram) -> Generated:
    """Return the functions of a program.

    Raises:
        Untraceable: an operation of its step has no counterpart in C.
    """
    parameters, state, inputs = program.parameters, program.state, program.inputs
    n = len(parameters.places)
    fixed, varying = _split(program.step, n)
    tables = Code().tables
    prepare, step, init = Code(tables=tables), Code(tables=tables), Code(tables=tables)

    known = _given(program.step.inputs[:n], parameters, "self->params", "given")
    frontier = _frontier(fixed, varying, program.step)
    derived, places = [], {}
    names: Counter[str] = Counter()
    for symbol, equation in frontier:
        name = equation.origin.name
        names[name] += 1
        unique = name if names[name] == 1 else f"{name}_{names[name]}"
        places[id(symbol)] = Storage(f"self->derived.{unique}", (), symbol.shape, type_of(symbol.dtype), "result")
    flat = Flat(program.step.inputs[:n], tuple(symbol for symbol, _ in frontier), fixed)
    lowering = Lowering(flat, known, prepare, {i: places[id(s)] for i, (s, _) in enumerate(frontier)})
    for equation in fixed:
        lowering.equation(equation)
    for symbol, _ in frontier:
        lowering.keep(symbol, places[id(symbol)])
    written = {id(statement.target) for statement in assigns(prepare.statements)}
    for symbol, _ in frontier:
        storage = places[id(symbol)]
        if id(storage) in written:
            derived.append(Derived(storage.name.removeprefix("self->derived."), storage.shape, storage.type))

    old = _storages(state.places, "self->state", "state")
    new = _storages(state.places, "next", "result")
    known |= {id(s): stored(o) for s, o in zip(program.step.inputs[n : n + len(old)], old, strict=True)}
    known |= _given(program.step.inputs[n + len(old) :], inputs, "in", "given")
    own = len(program.step.outputs) - len(old)
    answers = _storages(program.outputs.places[:own], "out", "result")
    results = dict(enumerate([*new, *answers]))
    Lowering(Flat((), program.step.outputs, varying), known, step, results).run()
    _drop_unchanged(step, old, new)
    settle(step, list(zip(old, new, strict=True)))

    begun = _given(program.init.inputs[:n], parameters, "self->params", "given")
    begun |= _given(program.init.inputs[n:], inputs, "first", "given")
    start = _storages(state.places, "self->state", "result")
    Lowering(program.init, begun, init, dict(enumerate(start))).run()
    operations = count(step)
    for code in (prepare, init, step):
        code.fused = fuse(code.statements)
    return Generated(tuple(derived), prepare, init, step, operations)


def _split(flat: Flat, parameters: int) -> tuple[tuple[Equation, ...], tuple[Equation, ...]]:
    """Part the equations into those that follow from the parameters alone and the rest."""
    fixed_symbols = {id(symbol) for symbol in flat.inputs[:parameters]}
    fixed, varying = [], []
    for equation in flat.equations:
        symbols = [id(atom) for atom in equation.inputs if isinstance(atom, Symbol)]
        # The numbers of an array stay together, those that are fixed too.
        if equation.primitive != "element" and all(one in fixed_symbols for one in symbols):
            fixed.append(equation)
            fixed_symbols |= {id(symbol) for symbol in equation.outputs}
        else:
            varying.append(equation)
    return tuple(fixed), tuple(varying)


def _frontier(
    fixed: tuple[Equation, ...], varying: tuple[Equation, ...], flat: Flat
) -> list[tuple[Symbol, Equation]]:
    """Return the fixed values that the varying equations or the results read."""
    read = {id(atom) for equation in varying for atom in equation.inputs} | {id(atom) for atom in flat.outputs}
    return [(symbol, equation) for equation in fixed for symbol in equation.outputs if id(symbol) in read]


def _storages(places: Places, root: str, role: Role) -> list[Storage]:
    return [storage_of(path, leaf, root, role) for path, leaf in places]


def member(path: Path) -> str:
    """Return how C reaches what lies at a path of a struct."""
    text = ""
    for key in path:
        text += f"[{key}]" if isinstance(key, int) else (f".{identifier(key)}" if text else identifier(key))
    return text


def storage_of(path: Path, leaf: Leaf, root: str, role: Role) -> Storage:
    """Return the place of an array below a struct."""
    cut = len(path)
    while cut and isinstance(path[cut - 1], int):
        cut -= 1
    name = root + ("->" if root in {"in", "out", "first"} else ".") + member(path[:cut])
    indices = tuple(Index(int(i)) for i in path[cut:])
    return Storage(name, indices, leaf.shape, leaf.kind, role, is_wide=leaf.is_sum)


def _given(symbols: tuple[Symbol, ...], slot: Slot, root: str, role: Role) -> dict[int, Value]:
    return {id(s): stored(p) for s, p in zip(symbols, _storages(slot.places, root, role), strict=True)}


def _drop_unchanged(code: Code, old: list[Storage], new: list[Storage]) -> None:
    """Remove the copies of what stays as it is."""
    pairs = {id(n): o for o, n in zip(old, new, strict=True)}

    def is_idle(s: Assign | Repeat) -> bool:
        if isinstance(s, Repeat):
            return False
        mine, value = pairs.get(id(s.target)), s.value
        return isinstance(value, Read) and value.storage is mine and value.indices == s.indices

    code.statements = [s for s in code.statements if not is_idle(s)]
