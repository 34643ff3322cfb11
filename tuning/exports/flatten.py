"""A traced function as one list of equations: calls inlined, constants folded, nothing twice, nothing unused."""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jax.extend import core as jex

import vsajax

_ROOT = Path(vsajax.__file__).parents[1]
_FOLDED = 64
"""Elements up to which the value of a constant expression is written out."""

CALLED = ("jaxpr", "call_jaxpr", "call")
"""What jax calls the body of a call."""
_VECTOR = 4
"""Numbers of one name from which they become an array."""


class Untraceable(ValueError):
    """A step that cannot leave Python, with the operation and the place in the source."""


@dataclass(frozen=True)
class Origin:
    """Where in the source an equation comes from.

    Args:
        place: file and function, e.g. ``vsajax/estimators/rls.py, step``.
        name: what the source calls the value.
        names: all names that its statement assigns to.
        statement: the line of that statement, in its file: values of one statement belong together.
    """

    place: str = ""
    name: str = "value"
    names: tuple[str, ...] = ()
    statement: str = ""


@dataclass(frozen=True, eq=False)
class Symbol:
    """A value that an equation computes, or that the function is given."""

    shape: tuple[int, ...]
    dtype: np.dtype


Atom = Symbol | np.ndarray


@dataclass(frozen=True, eq=False)
class Equation:
    """One operation of jax' own set.

    Args:
        primitive: its name.
        inputs: symbols and constants.
        outputs: symbols.
        params: as jax has them.
        origin: in the source.
    """

    primitive: str
    inputs: tuple[Atom, ...]
    outputs: tuple[Symbol, ...]
    params: Mapping[str, Any]
    origin: Origin


@dataclass(frozen=True)
class Turns:
    """What a loop with a fixed number of turns repeats.

    The body reads what lies outside as it is. Its own inputs are what is carried, then a row of each array that
    the loop runs over; its outputs are what is carried on, then a row of each array that the loop collects.

    Args:
        length: turns.
        is_reversed: whether it runs from the last row to the first.
        carried: how many values are carried.
        body: one turn.
    """

    length: int
    is_reversed: bool
    carried: int
    body: Flat

    def free(self) -> tuple[Symbol, ...]:
        """Return what the body reads from outside, each once."""
        own = {id(symbol) for symbol in self.body.inputs}
        own |= {id(symbol) for equation in self.body.equations for symbol in equation.outputs}
        read = [atom for equation in self.body.equations for atom in equation.inputs]
        symbols = [atom for atom in (*read, *self.body.outputs) if isinstance(atom, Symbol)]
        return tuple({id(symbol): symbol for symbol in symbols if id(symbol) not in own}.values())


@dataclass(frozen=True)
class Flat:
    """A function as equations in order, and as jax traced it where it was."""

    inputs: tuple[Symbol, ...]
    outputs: tuple[Atom, ...]
    equations: tuple[Equation, ...]
    closed: Any = None

    def used(self) -> frozenset[int]:
        """Return the positions of the inputs that anything reads."""
        read = {id(atom) for equation in self.equations for atom in equation.inputs}
        read |= {id(atom) for atom in self.outputs}
        return frozenset(i for i, symbol in enumerate(self.inputs) if id(symbol) in read)


def flatten(closed: Any) -> Flat:
    """Return a closed jaxpr as equations without calls; a loop of fixed length is one equation, see `Turns`.

    Raises:
        Untraceable: it loops or branches on data.
    """
    jaxpr = closed.jaxpr
    inputs = tuple(Symbol(tuple(aval.shape), np.dtype(aval.dtype)) for aval in closed.in_avals)
    flattener = _Flattener()
    outputs = flattener.run(jaxpr, closed.consts, inputs, Origin())
    return Flat(inputs, tuple(outputs), _needed(flattener.equations, outputs), closed)


@dataclass
class _Flattener:
    equations: list[Equation] = field(default_factory=list)
    seen: dict[Any, tuple[Symbol, ...]] = field(default_factory=dict)

    def run(self, jaxpr: Any, consts: Sequence[Any], arguments: Sequence[Atom], outer: Origin) -> list[Atom]:
        known: dict[Any, Atom] = dict(zip(jaxpr.invars, arguments, strict=True))
        known |= {var: np.asarray(value) for var, value in zip(jaxpr.constvars, consts, strict=True)}

        def read(atom: Any) -> Atom:
            if isinstance(atom, jex.Literal):
                aval: Any = atom.aval
                return np.asarray(atom.val, aval.dtype)
            return known[atom]

        for eqn in jaxpr.eqns:
            if not eqn.outvars:
                continue
            given = [read(atom) for atom in eqn.invars]
            origin = _origin(eqn.source_info.traceback, outer)
            inner = next((eqn.params[name] for name in CALLED if name in eqn.params), None)
            if eqn.primitive.name in {"while", "cond"}:
                raise Untraceable(
                    f"{eqn.primitive.name} ({origin.place or 'unknown place'}) branches or loops on data; "
                    "a step must not"
                )
            if eqn.primitive.name == "scan":
                results = self.turns(eqn, given, origin)
            elif eqn.primitive.name == "sum_of_products":
                written = jax.make_jaxpr(partial(eqn.primitive.impl, **eqn.params))(*(v.aval for v in eqn.invars))
                results = self.run(written.jaxpr, written.consts, given, origin)
            elif inner is not None:
                body, body_consts = (inner.jaxpr, inner.consts) if hasattr(inner, "consts") else (inner, ())
                results = self.run(body, body_consts, given, origin)
            else:
                results = self.apply(eqn, given, origin)
            known.update(zip(eqn.outvars, results, strict=True))
        return [read(atom) for atom in jaxpr.outvars]

    def turns(self, eqn: Any, given: list[Atom], origin: Origin) -> list[Atom]:
        """Return the results of a scan; what each of its turns would compute alike is computed ahead of it."""
        consts, carried, rows = map(list, eqn.params["ft_in"].update(given).unpack())
        body = eqn.params["jaxpr"]
        inputs = tuple(Symbol(tuple(var.aval.shape), np.dtype(var.aval.dtype)) for var in body.jaxpr.invars)
        inputs = inputs[len(consts) :]
        inner = _Flattener(seen=dict(self.seen))
        outputs = inner.run(body.jaxpr, body.consts, [*consts, *inputs], origin)
        varying = {id(symbol) for symbol in inputs}
        inside = []
        for equation in inner.equations:
            if any(id(atom) in varying for atom in equation.inputs):
                varying |= {id(symbol) for symbol in equation.outputs}
                inside.append(equation)
            else:
                self.equations.append(equation)
        ahead = {key: found for key, found in inner.seen.items() if not any(id(one) in varying for one in found)}
        self.seen |= ahead
        flat = Flat(inputs, tuple(outputs), tuple(inside))
        turns = Turns(eqn.params["length"], eqn.params["reverse"], len(carried), flat)
        results = tuple(Symbol(tuple(var.aval.shape), np.dtype(var.aval.dtype)) for var in eqn.outvars)
        self.equations.append(_loop((*carried, *rows), results, turns, origin))
        return list(results)

    def apply(self, eqn: Any, given: list[Atom], origin: Origin) -> list[Atom]:
        if eqn.primitive.name == "optimization_barrier":
            return self.once(given, [var.aval for var in eqn.outvars], origin)
        simpler = _simplify(eqn.primitive.name, given, eqn.outvars[0].aval)
        if simpler is not None:
            return [simpler]
        sizes = [int(np.prod(var.aval.shape)) for var in eqn.outvars]
        if all(isinstance(one, np.ndarray) for one in given) and max(sizes) <= _FOLDED:
            with jax.ensure_compile_time_eval():
                values = eqn.primitive.bind(*given, **eqn.params)
            return [np.asarray(v) for v in (values if eqn.primitive.multiple_results else [values])]
        return list(self.add(eqn.primitive.name, tuple(given), eqn.params, [v.aval for v in eqn.outvars], origin))

    def once(self, given: list[Atom], avals: list[Any], origin: Origin) -> list[Atom]:
        """Return the values of a barrier; where names share them out evenly, each name has an array of them."""
        share = len(given) // max(len(origin.names), 1)
        is_vector = (
            share * len(origin.names) == len(given) and share >= _VECTOR and {a.shape for a in avals} == {()}
        )
        results: list[Atom] = []
        for n, (one, aval) in enumerate(zip(given, avals, strict=True)):
            if not is_vector:
                results += self.add("once", (one,), {}, [aval], origin)
                continue
            named = replace(origin, name=origin.names[n // share], statement=f"{origin.statement}/{n // share}")
            results += self.add("element", (one,), {"n": n}, [aval], named)
        return results

    def add(
        self, primitive: str, given: tuple[Atom, ...], params: Mapping[str, Any], avals: list[Any], origin: Origin
    ) -> tuple[Atom, ...]:
        if primitive == "once" and isinstance(given[0], np.ndarray):
            return given
        key = (primitive, tuple(_identity(one) for one in given), repr(sorted(params.items(), key=str)))
        if key not in self.seen:
            outputs = tuple(Symbol(tuple(aval.shape), np.dtype(aval.dtype)) for aval in avals)
            self.equations.append(Equation(primitive, given, outputs, params, origin))
            self.seen[key] = outputs
        return self.seen[key]


def _identity(atom: Atom) -> Any:
    return (atom.tobytes(), atom.shape, str(atom.dtype)) if isinstance(atom, np.ndarray) else id(atom)


def _simplify(primitive: str, given: list[Atom], aval: Any) -> Atom | None:
    """Return what an operation leaves as it is: exact identities only."""

    def is_all(atom: Atom, value: float) -> bool:
        return isinstance(atom, np.ndarray) and bool(np.all(atom == value))

    def kept(atom: Atom) -> Atom | None:
        fits = tuple(atom.shape) == tuple(aval.shape) and np.dtype(atom.dtype) == np.dtype(aval.dtype)
        return atom if fits else None

    if primitive in {"convert_element_type", "copy", "stop_gradient", "copy_p", "lanes_minor"}:
        return kept(given[0])
    if primitive == "mul":
        if is_all(given[0], 1.0):
            return kept(given[1])
        return kept(given[0]) if is_all(given[1], 1.0) else None
    if primitive == "add" and is_all(given[0], 0.0):
        return kept(given[1])
    if (primitive in {"add", "sub"} and is_all(given[1], 0.0)) or (primitive == "div" and is_all(given[1], 1.0)):
        return kept(given[0])
    return None


def _loop(given: tuple[Atom, ...], results: tuple[Symbol, ...], turns: Turns, origin: Origin) -> Equation:
    """Return a loop as an equation of what it starts from, its rows, and what its body reads outside."""
    return Equation("scan", (*given, *turns.free()), results, {"turns": turns}, origin)


def _needed(equations: Sequence[Equation], outputs: Sequence[Atom]) -> tuple[Equation, ...]:
    wanted = {id(atom) for atom in outputs}
    kept = []
    for equation in reversed(equations):
        if not any(id(symbol) in wanted for symbol in equation.outputs):
            continue
        if equation.primitive == "scan":
            equation = _pruned(equation, wanted)
        kept.append(equation)
        wanted |= {id(atom) for atom in equation.inputs}
    return tuple(reversed(kept))


def _pruned(equation: Equation, wanted: set[int]) -> Equation:
    """Return a loop that carries and collects only what is wanted of it, and what that follows from."""
    turns: Turns = equation.params["turns"]
    body, carried = turns.body, turns.carried
    kept = {i for i, symbol in enumerate(equation.outputs) if id(symbol) in wanted}
    while True:
        needed = _needed(body.equations, [body.outputs[i] for i in sorted(kept)])
        read = {id(atom) for one in needed for atom in one.inputs} | {id(body.outputs[i]) for i in kept}
        follows = kept | {i for i in range(carried) if id(body.inputs[i]) in read}
        if follows == kept:
            break
        kept = follows
    places = [i for i in range(len(body.inputs)) if (i in kept if i < carried else id(body.inputs[i]) in read)]
    outputs = sorted(kept)
    flat = Flat(tuple(body.inputs[i] for i in places), tuple(body.outputs[i] for i in outputs), needed)
    shorter = Turns(turns.length, turns.is_reversed, sum(i < carried for i in outputs), flat)
    results = tuple(equation.outputs[i] for i in outputs)
    return _loop(tuple(equation.inputs[i] for i in places), results, shorter, equation.origin)


def _origin(traceback: Any, outer: Origin) -> Origin:
    """Return the innermost place in this repository, and the innermost name outside its scalar mathematics.

    Where there is neither it is that of the call around it.
    """
    frames = [] if traceback is None else [f for f in traceback.frames if _own(f.file_name) is not None]
    outside = [f for f in frames if not str(_own(f.file_name)).startswith("vsajax/numerics/")]
    if not outside and (outer.place or not frames):
        return outer
    outside = outside or frames
    first = outside[0]
    place = f"{_own(first.file_name)}, {first.function_name.replace('.<locals>', '')}"
    for frame in outside:
        named = _target(frame.file_name, frame.line_num)
        if named is not None:
            names, start = named
            # Where a statement unpacks (state, value), the value is what it is about.
            return Origin(place, names[-1], names, f"{frame.file_name}:{start}")
    return Origin(place, first.function_name.rpartition(".")[2].strip("_<>"))


@cache
def _own(file: str) -> str | None:
    """Return a file of the library as this repository calls it; `None` for any other."""
    path = Path(file)
    return path.relative_to(_ROOT).as_posix() if path.is_relative_to(_ROOT / "vsajax") else None


@cache
def _statements(file: str) -> dict[int, tuple[tuple[str, ...], int]]:
    """Return for every line of a file the names that its statement assigns to, and where that statement starts."""
    found: dict[int, tuple[tuple[str, ...], int]] = {}
    for node in ast.walk(ast.parse(Path(file).read_text(encoding="utf-8"))):
        if isinstance(node, ast.Assign) and len(node.targets) == 1:
            target = node.targets[0]
        elif isinstance(node, ast.AnnAssign | ast.AugAssign):
            target = node.target
        else:
            continue
        names = tuple(n.id for n in ast.walk(target) if isinstance(n, ast.Name))
        if names:
            found |= {line: (names, node.lineno) for line in range(node.lineno, (node.end_lineno or 0) + 1)}
    return found


def _target(file: str, line: int) -> tuple[tuple[str, ...], int] | None:
    return _statements(file).get(line)
